# SPDX-License-Identifier: Apache-2.0
"""Constants that the core shares with Python modules: written there, generated into C, and used."""

from pathlib import Path
import re
import subprocess
import sys

import pytest

from bev_preheat.code_generation.c_source import constants_header
from bev_preheat.vehicle.core_interface import constants, NAMES

CHECKOUT = Path(__file__).parents[2]
SOURCES = sorted([*(CHECKOUT / 'core' / 'src').glob('*.[ch]'),
                  *(CHECKOUT / 'bev_preheat' / 'code_generation' / 'c').glob('bev_ecu*.[ch]')])
NUMBER = re.compile(r'^(?:#define|(?:static )?const \w+) (\w+)(?: =)? \(?-?[0-9.]', re.MULTILINE)
GENERATED = constants()
SHARED = {name for names in NAMES.values() for name in names.split()}


@pytest.mark.parametrize('path', SOURCES, ids=lambda path: path.name)
def test_no_source_writes_a_shared_constant_again(path):
    written = {name.removeprefix('BEV_') for name in NUMBER.findall(path.read_text(encoding='utf-8'))}
    assert not written & SHARED


def test_the_header_has_each_number_to_the_last_bit():
    lines = dict(re.findall(r'^#define (BEV_\w+) \(?([^()\n]+)\)?$', constants_header(), re.MULTILINE))
    assert {name: float(text) for name, text in lines.items()} == GENERATED
    assert lines['BEV_LACK_PRICE'] == '2000.0'
    assert lines['BEV_MOST_LOOKS'] == '7'


def test_a_build_depends_on_every_module_that_the_sources_are_made_from():
    text = (CHECKOUT / 'core' / 'CMakeLists.txt').read_text(encoding='utf-8')
    patterns = re.findall(r'"\$\{checkout\}/(\S+\*\.py)"', text)
    watched = {path for pattern in patterns for path in CHECKOUT.glob(pattern)}
    loaded = subprocess.run(
        [sys.executable, '-c', 'import sys, bev_preheat.code_generation.c_source\n'
         'for name, module in sorted(sys.modules.items()):\n'
         '    if name.startswith("bev_preheat"): print(module.__file__)'],
        cwd=CHECKOUT, capture_output=True, text=True, check=True).stdout.split()
    assert {Path(path) for path in loaded} <= watched
