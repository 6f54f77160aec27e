# SPDX-License-Identifier: Apache-2.0
"""The bindings against the core's headers: structs, prototypes, memory and numbers, each by its name."""

from dataclasses import replace

import pytest

from bev_preheat.vehicle import core_calls as calls
from bev_preheat.vehicle import core_library as library
from bev_preheat.vehicle import core_structs as structs
from bev_preheat.vehicle.core_interface import COMMENT, constants, FILES, INCLUDE, read_headers, read_macros
from bev_preheat.vehicle.core_library import bindings, core

HEADERS, BINDINGS = read_headers(), bindings()
NUMBERS = {
    'BEV_MOST_AXIS': structs.MOST_AXIS, 'BEV_MOST_FACTORS': structs.MOST_FACTORS,
    'BEV_CURVE_PARAMETERS': structs.PARAMETERS, 'BEV_VALUE_POINTS': structs.VALUE_POINTS,
    'BEV_VALUE_KEPT_EVERY': structs.VALUE_KEPT_EVERY,
    'BEV_ELEMENTS': structs.ELEMENTS, 'BEV_BOUNDED': structs.BOUNDED,
    'BEV_MOST_HEATERS': structs.MOST_HEATERS,
    'BEV_OK': library.OK, 'BEV_SATURATED': library.SATURATED,
    'BEV_EMPTY': library.EMPTY, 'BEV_NO_CROSSING': library.NO_CROSSING, 'BEV_LIMITED': library.LIMITED,
    'BEV_CHEAPER_ELSEWHERE': library.CHEAPER_ELSEWHERE,
    'BEV_POLYNOMIAL': structs.POLYNOMIAL, 'BEV_POLYNOMIAL_AND_LOGARITHM': structs.POLYNOMIAL_AND_LOGARITHM,
    'BEV_INVERSE_TEMPERATURE': structs.INVERSE_TEMPERATURE, 'BEV_TABLE': structs.TABLE,
    **{f'BEV_{name}': calls.INTEGRATORS[make] for name, make in (
        ('EULER', calls.make_euler), ('MIDPOINT', calls.make_midpoint),
        ('RUNGE_KUTTA_4', calls.make_runge_kutta_4))}}


def macros():
    text = '\n'.join((INCLUDE / name).read_text(encoding='utf-8') for name in FILES)
    return read_macros(COMMENT.sub('', text).replace('\\\n', ' '))


@pytest.mark.parametrize('kind, name', [
    (kind, name) for kind in ('structs', 'functions', 'memory')
    for name in sorted({*getattr(HEADERS, kind), *getattr(BINDINGS, kind)})])
def test_fields_prototypes_and_memory_are_those_of_the_header(kind, name):
    assert getattr(BINDINGS, kind)[name] == getattr(HEADERS, kind)[name]


@pytest.mark.parametrize('name', NUMBERS)
def test_numbers_are_those_of_the_header(name):
    assert macros()[name] == NUMBERS[name]


@pytest.mark.parametrize('name', sorted(constants()))
def test_a_library_with_another_constant_is_not_used(name):
    """A library that was built before a number changed plans with the number from before."""
    changed = {**constants(), name: constants()[name] * 1.5}
    assert BINDINGS.digest(changed) != core().bev_interface()


@pytest.mark.parametrize('changed', [
    replace(HEADERS, number=0),
    replace(HEADERS, structs={**HEADERS.structs, 'bev_stranding': (('driven_share', 'D', 1), ('step', 'I', 1))}),
    replace(HEADERS, functions={**HEADERS.functions, 'bev_run': 'P'}),
    replace(HEADERS, memory={**HEADERS.memory, 'BEV_SWITCH_MEMORY': (9, 8)})],
    ids=['number', 'order of fields', 'prototype', 'memory'])
def test_each_change_has_another_digest(changed):
    assert changed.digest({}) != HEADERS.digest({})
    assert 0 <= changed.digest({}) < 2 ** 31


@pytest.mark.parametrize('struct', ['unsigned x;', 'uint8_t x;', 'double x, y;', 'double x[2][2];'])
def test_what_cannot_be_read_is_refused(tmp_path, struct):
    for name in FILES:
        (tmp_path / name).write_text('')
    (tmp_path / 'core.h').write_text(
        f'#define BEV_INTERFACE 6\ntypedef struct {{\n  double a;\n  {struct}\n}} bev_x;\n')
    with pytest.raises(ValueError, match='is no field as it can be read'):
        read_headers(tmp_path)
