# SPDX-License-Identifier: Apache-2.0
"""
Cars whose parameters are known, simulated by equations of their own, and identified from their logs.

The bounds of one car are one and a half to two times the errors of 95 % of the cars (docs/how-to/identify.md).
"""

import pytest

pytestmark = [pytest.mark.costly, pytest.mark.needs('casadi', 'scipy')]
MOST_ERROR = {'heat_capacity': 0.045, 'leakage': 0.06, 'drivetrain_heat': 0.075, 'heater_efficiency': 0.045,
              'capacity': 0.01, 'resistance at -5 degC': 0.04, 'resistance at 5 degC': 0.04}


# Daily, test_identify_command.py identifies a synthetic car without a heater.
@pytest.mark.deep
@pytest.mark.parametrize('seed', [3, *range(20, 26)])
def test_the_truth_is_found_within_its_interval(seed):
    from bev_preheat_studies.identification.study import car_result
    outcomes = {outcome.name: outcome for outcome in car_result('small_car', True, seed, 0).outcomes}
    for name, most in MOST_ERROR.items():
        assert abs(outcomes[name].error) < most, name
    # Eight of ten 90 % intervals, because a tenth may miss.
    covered = [outcome.is_covered for outcome in outcomes.values()]
    assert sum(covered) >= 0.7 * len(covered)
