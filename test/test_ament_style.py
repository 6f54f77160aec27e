# SPDX-License-Identifier: Apache-2.0
"""The style checks of ament_flake8 and ament_pep257, which `colcon test` runs for a ROS package."""

import logging
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
# docs/gallery has copies of the examples, made by `make docs`.
PLACES = [str(ROOT / name) for name in ('bev_preheat', 'docs/examples', 'scripts', 'setup.py', 'studies', 'test')]
PLACES += map(str, sorted((ROOT / 'docs').glob('*.py')))
# The docstring of an example is its page's heading and first paragraph, as sphinx-gallery reads it.
EXAMPLES = str(ROOT / 'docs/examples')
# As in setup.cfg: properties have the names of things.
DOCSTRING_RULES_LEFT_OUT = ('D401', 'D402', 'D403')

pytestmark = pytest.mark.linter


@pytest.mark.needs('ament_flake8')
def test_flake8():
    from ament_flake8.main import main_with_errors
    status, errors = main_with_errors(argv=['--config', str(ROOT / 'setup.cfg'), *PLACES])
    assert (status, errors) == (0, [])


@pytest.mark.needs('ament_pep257')
def test_pep257():
    from ament_pep257.main import main
    # It lists each checked file as information.
    logging.getLogger('pydocstyle.utils').setLevel(logging.ERROR)
    assert main(argv=['--add-ignore', *DOCSTRING_RULES_LEFT_OUT, '--exclude', EXAMPLES, '--', *PLACES]) == 0
