# SPDX-License-Identifier: Apache-2.0
"""The table of the step's numbers: each has a unit and a reason, and no room of the step has others."""

import ast
from pathlib import Path
import re

import pytest

from bev_preheat import tunables

CHECKOUT = Path(__file__).parents[1]
TABLE = Path(tunables.__file__).read_text(encoding='utf-8')
ROW = re.compile(r'([A-Z][A-Z0-9_]*) = [^#]+  # (\S+) +\| ([^|]{4,}[^ |])( \| \d+\.\d{3} K)?')
NAMES = {name for name in vars(tunables) if name.isupper()}
UNIT_IN_NAME = {
    '_K': 'K', '_S': 's', '_NS': 'ns', '_W': 'W', '_WH': 'Wh', '_M': 'm', '_A': 'A', '_J': 'J', '_K_PER_S': 'K/s',
    '_K_PER_KW': 'K/kW', '_WH_PER_K': 'Wh/K', '_PER_S': '1/s', '_SHARE': '1', '_SOC': '1'}
ROOMS = ('control', 'estimation', 'planning')
# Sizes of arrays and caches, formats, limits of files and texts, units, closed forms: no numbers to be tuned.
OTHERS = {
    'CHARGE', 'DAYS_A_WEEK', 'FORMATS_WITH_CARS', 'FORMAT_KEY', 'GOLDEN', 'HEALTHY', 'KELVIN_K', 'LATEST_NS',
    'LONGEST_STATE_SENTENCE', 'LONGEST_ZONE_NAME', 'MOST_CARS', 'MOST_KEPT_SEGMENTS',
    'MOST_REMEMBERED', 'NO_CHANGES', 'PASSES', 'PLACES', 'PLACE_DEVIATIONS', 'PLACE_LAGS_S',
    'PLACE_LAG_DEVIATIONS', 'PLACE_WEIGHTS', 'ROUNDING_NS', 'SHARES', 'SHIFTS', 'SIZE',
    'SOC_STEPS', 'STATE_FILE_FORMAT', 'STATE_FORMAT', 'STUCK', 'TEMPERATURE_RANGE_C', 'TEMPERATURE_STEPS_K',
    'WARMTH', 'WEEK_NS'}
# Where a series takes over from a closed form.
CLOSED_FORMS = {'truncated_normal'}
# Without a name: ends of ranges, counts, halves, percents.
PLAIN = {0, 1, 2, 3, 0.5, 100}


def rows():
    return [line for line in TABLE.splitlines() if re.match(r'[A-Z_0-9]+ =', line)]


def test_each_row_has_unit_and_reason():
    assert not [line for line in rows() if not ROW.fullmatch(line)]
    for name, unit, *_ in ROW.findall(TABLE):
        ending = max((each for each in UNIT_IN_NAME if name.endswith(each)), key=len, default='')
        assert unit == UNIT_IN_NAME.get(ending, unit), name


def test_each_number_has_one_row():
    assert [line.split()[0] for line in rows()] == list(dict.fromkeys(line.split()[0] for line in rows()))
    assert {line.split()[0] for line in rows()} == NAMES


def test_each_number_is_used():
    used = {name for path in CHECKOUT.glob('bev_preheat/**/*.py') if path.name != 'tunables.py'
            for name in re.findall(r'\w+', path.read_text(encoding='utf-8'))}
    assert not NAMES - used


def test_no_other_file_has_a_number_of_the_same_name():
    """The study sets a number wherever its name is imported."""
    assigned = re.compile(r'^([A-Z][A-Z0-9_]*)\b(?:: [^=]+)? = ', re.MULTILINE)
    assert not [f'{path}: {name}' for path in CHECKOUT.glob('bev_preheat/**/*.py') if path.name != 'tunables.py'
                for name in assigned.findall(path.read_text(encoding='utf-8')) if name in NAMES]


def is_number(value):
    if isinstance(value, ast.BinOp):
        return is_number(value.left) or is_number(value.right)
    if isinstance(value, ast.UnaryOp):
        return is_number(value.operand)
    if isinstance(value, ast.Tuple):
        return bool(value.elts) and any(map(is_number, value.elts))
    return isinstance(value, ast.Constant) and type(value.value) in (int, float)


def files():
    return [path for room in ROOMS for path in sorted((CHECKOUT / 'bev_preheat' / room).glob('*.py'))]


@pytest.mark.parametrize('path', files(), ids=lambda path: f'{path.parent.name}/{path.stem}')
def test_a_room_of_the_step_has_no_numbers_of_its_own(path):
    """Neither named ones, but for sizes, formats and units, nor thresholds in comparisons."""
    tree = ast.parse(path.read_text(encoding='utf-8'))
    named = {name.id for node in tree.body
             if isinstance(node, ast.Assign | ast.AnnAssign) and is_number(node.value)
             for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
             for name in ast.walk(target) if isinstance(name, ast.Name)}
    assert not {name for name in named if not name.startswith(('KEPT_', 'LARGEST_'))} - OTHERS
    compared = [each.value for node in ast.walk(tree) if isinstance(node, ast.Compare)
                for side in (node.left, *node.comparators) for each in ast.walk(side)
                if isinstance(each, ast.Constant) and type(each.value) in (int, float)]
    assert not set(compared) - PLAIN or path.stem in CLOSED_FORMS
