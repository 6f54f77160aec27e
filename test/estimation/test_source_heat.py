# SPDX-License-Identifier: Apache-2.0
"""Heat of sources beside the HVCH that differs from the vehicle file, with the simulated car of `driven_car`."""

from dataclasses import replace

from driven_car import Commands, DRIVE, DrivenCar, observed, VEHICLE
import numpy as np
import pytest

from bev_preheat.estimation.estimate import SOURCE_HEAT
from bev_preheat.estimation.estimator import Estimator
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.estimation.prior import FACTOR_DEVIATIONS
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import Uncertainty

# Of any car with sources, the estimator reads only that there are some.
CAR = replace(VEHICLE, heat_sources=load_vehicle('heat_pump_car').heat_sources)
DRAWN_W, PROMISED_W, SECONDS = 2500.0, 5000.0, 2400
PROMISED = replace(DRIVE, source_heat_w=PROMISED_W, auxiliary_power_w=DRIVE.auxiliary_power_w + DRAWN_W)
UNHEATED, LATE = Commands(), Commands(((1200, SECONDS),))


def driven(share, commands=UNHEATED, promised_w=PROMISED_W, **car):
    """Return the Estimator and the greatest error of its temperature in the last half hour [K]."""
    estimator, errors_k, promised = Estimator.of(CAR), [], replace(PROMISED, source_heat_w=promised_w)
    car = DrivenCar(commands=commands, source_w=(DRAWN_W, share * promised_w), step_k=0.1, noise_k=0.1, **car)
    for second in range(SECONDS):
        estimator = observed(estimator, car.drive(), commands, promised, CAR)
        if second > SECONDS - 1800:
            errors_k.append(abs(estimator.estimate.temperature_c - car.temperature_c))
    return estimator, max(errors_k)


@pytest.mark.parametrize('share', [0.7, 0.85, 1.0, 1.25])
@pytest.mark.parametrize('commands, promised_w, start_c', [
    (UNHEATED, PROMISED_W, -6.0), (LATE, PROMISED_W, -6.0), (UNHEATED, -PROMISED_W, 45.0)],
                         ids=['source alone', 'HVCH joins', 'cold'])
def test_the_heat_or_cold_of_a_watt_is_found(share, commands, promised_w, start_c):
    estimator, error_k = driven(share, commands, promised_w, temperature_c=start_c)
    estimate = estimator.estimate
    # Two thirds of the deviation; the rest may be that of the heat capacity.
    assert np.exp(estimate.mean[SOURCE_HEAT]) == pytest.approx(share, abs=abs(1.0 - share) / 3.0 + 0.03)
    # Neither the HVCH nor a fault stands for it.
    assert estimate.corrections.heater_efficiency == pytest.approx(1.0, abs=0.05)
    assert estimate.heater.heater is Heater.ANSWERS
    assert error_k < 1.0


def test_heat_that_comes_late_is_not_missing_for_long():
    estimator, error_k = driven(1.0, heat_lag_s=120.0)
    assert np.exp(estimator.estimate.mean[SOURCE_HEAT]) == pytest.approx(1.0, abs=0.1)
    assert error_k < 1.5


@pytest.mark.parametrize('stated, expected', [(None, 0.1), (0.06, 0.06), (0.005, 0.03), (1.0, 0.1)])
def test_a_file_states_how_well_it_knows_the_heat_of_a_watt(stated, expected):
    belief = Estimator.of(replace(CAR, uncertainty=Uncertainty(source_heat=stated))).belief
    assert np.sqrt(belief.covariance[..., SOURCE_HEAT, SOURCE_HEAT]) == pytest.approx(expected)


def test_a_car_without_sources_learns_nothing_about_them():
    estimator, car = Estimator.of(VEHICLE), DrivenCar(commands=LATE)
    for _ in range(SECONDS):
        estimator = observed(estimator, car.drive(), LATE)
    # It only wanders: a deviation of 0.05 after an hour.
    mean, covariance = estimator.belief.mean, estimator.belief.covariance
    assert not mean[..., SOURCE_HEAT].any()
    assert np.sqrt(covariance[..., SOURCE_HEAT, SOURCE_HEAT]).max() < 0.05 < FACTOR_DEVIATIONS[SOURCE_HEAT]
