# SPDX-License-Identifier: Apache-2.0
"""Every mention of supported Python versions agrees with scripts/pythons.txt."""

import configparser
from pathlib import Path
import re
import sys

import pytest

ROOT = Path(__file__).parents[1]
PYTHONS = (ROOT / 'scripts' / 'pythons.txt').read_text().split()


def as_numbers(version):
    return tuple(map(int, version.split('.')))


def test_versions_rise_and_this_one_is_among_them():
    assert sorted(PYTHONS, key=as_numbers) == PYTHONS
    assert as_numbers(PYTHONS[0]) <= sys.version_info[:2] <= as_numbers(PYTHONS[-1])


@pytest.mark.parametrize('path, join', [
    ('README.md', 'or'), ('docs/how-to/ros_machine.md', 'or'), ('QUALITY_DECLARATION.md', 'and')])
def test_documents_name_these_versions(path, join):
    words = f'{", ".join(PYTHONS[:-1])} {join} {PYTHONS[-1]}'
    assert re.search(rf'Python,? {re.escape(words)}', (ROOT / path).read_text())


def test_types_are_checked_for_the_oldest():
    setup = configparser.ConfigParser()
    setup.read(ROOT / 'setup.cfg')
    assert setup['mypy']['python_version'] == PYTHONS[0]
