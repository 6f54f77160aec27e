# SPDX-License-Identifier: Apache-2.0
"""Simulated cars with several heat sources: balances of their own."""

from dataclasses import replace

from level_car import route_of
import numpy as np
import pytest

from bev_preheat.planning.situation import BatteryState
from bev_preheat.simulation.heater import HeaterLease
from bev_preheat.simulation.vehicle_plant import VehiclePlant
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath

CAR = load_vehicle('heat_pump_car')
COMMANDS_W = {'motor': 1700.0, 'heat_pump': 900.0}
# Motor 0.75; heat pump in air of -10 degC, battery at 0 and at 25 degC: 2.0 and 1.6.
MINUTE_S = 60.0


def driven(vehicle=CAR, seconds=60.0, speed_mps=20.0, temperature_c=5.0, until_s=60.0, shares=None,
           commands_w=COMMANDS_W, drives=True, ambient_c=-10.0, cabin_w=800.0):
    route = route_of(seconds, power_w=9e3, speed_mps=speed_mps, ambient_c=ambient_c, cabin_w=cabin_w)
    plant = VehiclePlant(vehicle, route, BatteryState(temperature_c, 0.8))
    plant.sources.shares.update(shares or {})
    if drives:
        plant.advance_under(HeaterLease(0.0, until_s, commands_w), seconds)
    return plant


def test_heat_and_power_of_the_sources():
    with_sources, without = driven(), driven(replace(CAR, heat_sources=()))
    heat_j = MINUTE_S * (1700.0 * 0.75 + 900.0 * (2.0 - 0.4 * 5.0 / 25.0))
    warmer_k = with_sources.temperature_c - without.temperature_c
    assert warmer_k * CAR.battery.heat_capacity_j_per_k == pytest.approx(heat_j, rel=0.02)
    assert with_sources.sources.energy_wh == pytest.approx(
        {'motor': 1700.0 / 60.0, 'heat_pump': 15.0, 'chiller': 0.0})
    energies = with_sources.energy_wh
    assert energies.hvch_electric == pytest.approx(2600.0 / 60.0)
    assert energies.hvch_heat == pytest.approx(heat_j / 3600.0, rel=2e-3)
    more_wh = energies.battery_total - without.energy_wh.battery_total
    assert more_wh == pytest.approx(2600.0 / 60.0 + energies.joule - without.energy_wh.joule, abs=0.01)


@pytest.mark.parametrize('shares_cabin_limit, motor_w', [(False, 3000.0), (True, 3000.0 - 800.0)])
def test_the_cabin_comes_first_at_a_source_that_serves_it_too(shares_cabin_limit, motor_w):
    car = replace(CAR, heat_sources=tuple(
        replace(source, shares_cabin_limit=shares_cabin_limit) for source in CAR.heat_sources))
    plant = driven(car, commands_w={'motor': 9000.0})
    assert plant.sources.energy_wh['motor'] == pytest.approx(motor_w / 60.0)


def test_heat_of_the_sources_takes_the_way_of_the_coolant():
    late = replace(CAR, heat_path=HeatPath(0.0, 20e3, 300.0))
    plant = driven(late)
    assert plant.coolant_c > plant.temperature_c + 3.0
    assert plant.energy_wh.hvch_electric == pytest.approx(2600.0 / 60.0)


@pytest.mark.parametrize(('changes', 'motor_wh', 'pump_wh'), [
    ({'speed_mps': 0.0}, 0.0, 15.0),
    ({'until_s': 30.0}, 1700.0 / 120.0, 7.5),
    ({'shares': {'heat_pump': 0.0, 'motor': 0.5}}, 1700.0 / 120.0, 0.0),
    ({'ambient_c': -26.0}, 1700.0 / 60.0, 0.0),
    ({'ambient_c': -24.0}, 1700.0 / 60.0, 500.0 / 60.0)])
def test_a_source_heats_as_far_as_it_may(changes, motor_wh, pump_wh):
    assert driven(**changes).sources.energy_wh == pytest.approx(
        {'motor': motor_wh, 'heat_pump': pump_wh, 'chiller': 0.0})


PUMP = {'power_steps_w': (800.0, 1000.0, 2000.0), 'minimum_off_time_s': 50.0}
STEPPED = replace(CAR, heat_sources=tuple(
    replace(source, **PUMP) if source.name == 'heat_pump' else source for source in CAR.heat_sources))


@pytest.mark.parametrize(('command_w', 'power_w'), [(799.0, 800.0), (790.0, 0.0), (1990.0, 1000.0), (9e3, 2000.0)])
def test_a_source_with_steps_runs_at_the_step_below_its_command(command_w, power_w):
    plant = driven(STEPPED, seconds=10.0, commands_w={'heat_pump': command_w})
    assert plant.sources.energy_wh['heat_pump'] == pytest.approx(power_w / 360.0)


@pytest.mark.parametrize('next_route_at', [5, 0], ids=['on two routes', 'on one'])
def test_a_source_that_was_on_rests_before_it_starts_again(next_route_at):
    plant = driven(STEPPED, seconds=500.0, drives=False)
    powers_w = []
    for second in range(0, 200, 10):
        is_on = second < 20 or 40 <= second < 60 or second >= 80
        plant.advance_under(HeaterLease(0.0, np.inf, {'heat_pump': 1000.0 * is_on}), second + 10.0)
        powers_w.append(plant.sources.powers_w['heat_pump'])
        if len(powers_w) == next_route_at:
            plant = plant.followed_by(STEPPED, plant.route)
    # Off at 20 s: it may start from 70 s on.
    assert powers_w == [1000.0] * 2 + [0.0] * 6 + [1000.0] * 12


@pytest.mark.parametrize(('temperature_c', 'power_w', 'cold'), [
    (55.0, 2400.0, 2.6), (45.0, 2400.0, 2.6), (22.5, 1500.0, 2.02), (19.0, 0.0, 1.0)])
def test_a_chiller_cools_down_to_its_temperature(temperature_c, power_w, cold):
    def driven_c(command_w):
        plant = driven(seconds=10.0, temperature_c=temperature_c, commands_w={'chiller': command_w},
                       ambient_c=35.0, cabin_w=0.0)
        assert plant.sources.energy_wh['chiller'] == pytest.approx(min(command_w, power_w) / 360.0, rel=0.02)
        return plant.temperature_c

    cooled_j = (driven_c(0.0) - driven_c(2400.0)) * CAR.battery.heat_capacity_j_per_k
    assert cooled_j == pytest.approx(cold * power_w * 10.0, rel=0.03)
