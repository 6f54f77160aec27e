# SPDX-License-Identifier: Apache-2.0
"""A build installs both packages, and with BEV_PREHEAT_WITHOUT_STUDIES=1 only the product."""

import os
from pathlib import Path
import subprocess
import sys

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]


@pytest.mark.costly
@pytest.mark.parametrize('without, packages', [
    # make build leaves the variable out.
    ('0', ['bev_preheat', 'bev_preheat_studies']),
    ('1', ['bev_preheat'])])
def test_the_studies_can_be_left_out(tmp_path, without, packages):
    subprocess.run([sys.executable, 'setup.py', '--quiet', 'egg_info', '--egg-base', str(tmp_path)], cwd=CHECKOUT,
                   env={**os.environ, 'BEV_PREHEAT_WITHOUT_STUDIES': without}, check=True, capture_output=True,
                   timeout=120)
    assert (tmp_path / 'bev_preheat.egg-info/top_level.txt').read_text().split() == packages
