# SPDX-License-Identifier: Apache-2.0
"""Values of START that logs do not tell stay, unless the logs refute them together."""

from types import SimpleNamespace

import pytest

from bev_preheat.identification.parameters import parameters_of
from bev_preheat.identification.uncertainty import Interval
from bev_preheat.vehicle import load_vehicle

pytestmark = pytest.mark.needs('scipy')
PARAMETERS = parameters_of(load_vehicle('small_car'))
FULL = SimpleNamespace(structure='one mass', electrical=None, cost=100.0)


def kept(rises, told=('heat_capacity',)):
    """Return the names that keep START's values; `rises` are costs above that of FULL by the held names."""
    # Loads SciPy and CasADi.
    from bev_preheat.identification.identify import keep_start

    def fit(structure, electrical, begin, held):
        assert (structure, electrical, begin) == ('one mass', None, FULL)
        return SimpleNamespace(cost=100.0 + rises[frozenset(held)], held=dict(held))

    intervals = {}
    for name in ('heat_capacity', 'leakage', 'drivetrain_heat'):
        parameter = PARAMETERS[name]
        reach = (0.5 if name in told else 1.0) * 1.6449 * parameter.deviation
        intervals[name] = Interval(parameter.prior - reach, parameter.prior + reach)
    # The share of drivetrain heat begins at 0: its prior's interval is cut there, and its own is as wide.
    held, found = keep_start(SimpleNamespace(parameters=PARAMETERS, fit=fit), FULL, intervals)
    assert found.held == held
    assert all(at == PARAMETERS[name].prior for name, at in held.items())
    return set(held)


BOTH, ONE, OTHER, NONE = (frozenset(names) for names in (
    ('leakage', 'drivetrain_heat'), ('leakage',), ('drivetrain_heat',), ()))


@pytest.mark.parametrize('rises, staying', [
    # A chi-squared variable of two degrees of freedom is below 4.605 in 90 % of cases: -2 ln 0.1.
    ({BOTH: 2.29}, BOTH), ({BOTH: 2.32, ONE: 2.2, OTHER: 0.4}, OTHER),
    # Of one degree of freedom: below 1.645^2 = 2.706.
    ({BOTH: 30.0, ONE: 9.0, OTHER: 1.34}, OTHER), ({BOTH: 30.0, ONE: 9.0, OTHER: 1.36, NONE: 0.0}, NONE)],
    ids=['both', 'the value refuted less', 'the only possible value', 'neither'])
def test_values_that_are_not_told_stay_unless_they_are_refuted(rises, staying):
    assert kept(rises) == staying


def test_told_values_never_stay():
    assert kept({NONE: 0.0}, told=('heat_capacity', 'leakage', 'drivetrain_heat')) == NONE
