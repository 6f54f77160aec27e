# SPDX-License-Identifier: Apache-2.0
"""
Cars whose parameters are known, simulated by equations of their own, and identified from their logs.

The bounds of one car are one and a half to two times the errors of 95 % of the cars (docs/how-to/identify.md).
"""

import pytest

from bev_preheat.vehicle import load_vehicle

pytestmark = [pytest.mark.costly, pytest.mark.needs('casadi', 'scipy')]
MOST_ERROR = {'heat_capacity': 0.045, 'leakage': 0.06, 'drivetrain_heat': 0.075, 'heater_efficiency': 0.045,
              'capacity': 0.01, 'resistance at -5 degC': 0.04, 'resistance at 5 degC': 0.04}


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


# Daily, test_identify_command.py identifies a synthetic car without a heater.
@pytest.mark.deep
def test_nights_alone_beside_drives_tell_the_leakage_and_no_heater_says_so():
    import numpy as np

    from bev_preheat.identification.electrical import fit_electrical
    from bev_preheat.identification.fit import Fitter
    from bev_preheat.identification.trips import trips_of
    from bev_preheat.identification.uncertainty import bootstrap_intervals
    from bev_preheat_studies.identification.synthetic_car import draw_car, record_car
    vehicle, generator = load_vehicle('small_car'), np.random.default_rng(5)
    car = draw_car(generator, vehicle)
    trips = trips_of(record_car(car, generator, heats=False), vehicle)
    fitter = Fitter(vehicle, trips)
    fit = fitter.fit('one mass', fit_electrical(vehicle, trips))
    intervals = bootstrap_intervals(fit)
    # Coordinates: logarithm of the leakage at 1, heater efficiency at 4.
    assert intervals[1].high - intervals[1].low < 0.5
    prior = fitter.parameters['heater_efficiency']
    assert intervals[4].high - intervals[4].low > 0.8 * 2 * 1.645 * prior.deviation
    assert fit.theta[4] == pytest.approx(prior.prior, abs=1e-6)
