# SPDX-License-Identifier: Apache-2.0
"""Heat while the vehicle charges: only if enabled, supplied by the charger, and needed."""

from dataclasses import replace

import pytest
from steady_drives import NOW_NS, ns, steady_leg, VEHICLE
from stepwise import Stepwise

from bev_preheat.control.charger_heat import ChargerHeater, ChargerSituation
from bev_preheat.control.command import Commander
from bev_preheat.control.inputs import Measurement, Mission, with_stops
from bev_preheat.control.settings import Settings
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status

# Only time counts, and below FAST_W the charger is faster than the battery: then all heat pays.
ASKED = Settings(estimation=False, heat_while_charging=True, energy_price_per_kwh=0.0)
FAST_W = 300e3
VOLTAGE_V = 400.0
# Of the 7 kW of the heater.
CABIN_W, HEAT_W = 1500.0, 5500.0
DRIVE_S, STOP_S = 600.0, 1200.0
LIMIT_C = VEHICLE.charging.heating_limit_c


def make_leg(**fields):
    return steady_leg(DRIVE_S, propulsion_power_w=[18e3], ambient_temperature_c=[-5.0],
                      target_temperature_c=None, **fields)


def measured(temperature_c, charged_with_w, now_ns=NOW_NS, soc=0.4):
    """Return a Measurement of a battery charged with this power [W]; None: unknown."""
    current_a = None if charged_with_w is None else -charged_with_w / VOLTAGE_V
    return Measurement(BatteryState(temperature_c, soc), now_ns, VOLTAGE_V, current_a)


def supervisor_at(elapsed_s, settings=ASKED, vehicle=VEHICLE, **first):
    """Return a supervisor on a trip that started before NOW_NS: a drive, a stop, a drive."""
    supervisor = Stepwise(vehicle, settings)
    supervisor.accept_mission(Mission('one stop', with_stops(
        (make_leg(start_ns=NOW_NS - ns(elapsed_s), **first),
         make_leg(departure=BatteryState(20.0, 0.8))), (STOP_S,))))
    return supervisor


def outcome(supervisor, measurement, now_ns=NOW_NS):
    supervisor.accept_battery(measurement, now_ns)
    command = supervisor.command(now_ns)
    return command.battery_heating_power_w, command.reason


AT_STOP_S = DRIVE_S + 60.0
CHARGING, OFF = (HEAT_W, Status.CHARGING), (0.0, Status.CHARGING)


@pytest.mark.parametrize('temperature_c, charged_with_w, expected', [
    (-3.0, FAST_W, CHARGING), (-3.0, HEAT_W, OFF), (-3.0, 0.0, OFF), (-3.0, -20e3, OFF), (-3.0, None, OFF),
    (LIMIT_C - 1.1, FAST_W, CHARGING), (LIMIT_C - 0.9, FAST_W, OFF), (LIMIT_C + 5.0, FAST_W, OFF),
    # The charger gives no more, so all that the heater takes is missing.
    (-3.0, HEAT_W + 1.0, OFF)])
def test_it_heats_where_the_charger_gives_enough_to_a_cold_battery(
        temperature_c, charged_with_w, expected):
    supervisor = supervisor_at(AT_STOP_S)
    assert outcome(supervisor, measured(temperature_c, charged_with_w)) == expected


@pytest.mark.parametrize('settings, charging, first', [
    (replace(ASKED, heat_while_charging=False), VEHICLE.charging, {}),
    (ASKED, None, {}), (ASKED, replace(VEHICLE.charging, battery_heating=None), {}),
    (ASKED, replace(VEHICLE.charging, battery_heating=False), {}),
    (ASKED, VEHICLE.charging, {'charging_planned': False})],
    ids=['not asked for', 'nothing known of the car', 'not said', 'car that does not', 'no charging'])
def test_it_does_not_heat_unasked_nor_in_a_car_that_does_not(settings, charging, first):
    supervisor = supervisor_at(AT_STOP_S, settings, replace(VEHICLE, charging=charging), **first)
    assert outcome(supervisor, measured(-3.0, 50e3)) == OFF


@pytest.mark.parametrize('minimum_soc, expected', [(0.39, CHARGING), (0.41, OFF)])
def test_the_gates_of_the_car_hold_at_the_charger_too(minimum_soc, expected):
    gated = replace(VEHICLE, heating_gates=replace(VEHICLE.heating_gates, minimum_soc=minimum_soc))
    assert outcome(supervisor_at(AT_STOP_S, vehicle=gated), measured(-3.0, FAST_W, soc=0.4)) == expected


def test_what_cooled_on_the_way_heats_at_the_charger():
    supervisor = supervisor_at(AT_STOP_S)
    assert outcome(supervisor, measured(-3.0, FAST_W)) == CHARGING
    state = supervisor.state
    commander, command = Commander(cools=True).give(state.moment, state.decision, None)
    assert (command.battery_heating_power_w, commander.direction) == (HEAT_W, 1)


def test_a_cabin_that_takes_the_whole_heater_leaves_nothing():
    leg, measurement = make_leg(cabin_heating_power_w=[11.5e3]), measured(-3.0, 50e3)
    _, heat = ChargerHeater().heat(ChargerSituation(
        VEHICLE, leg, measurement, measurement.state, ASKED.prices))
    assert heat == (0.0, 'No heating: the cabin takes the whole heater power.')


def test_what_heats_goes_on_with_less_and_ends_when_the_battery_is_discharged():
    supervisor = supervisor_at(AT_STOP_S)
    seen = [outcome(supervisor, measured(temperature_c, charged_with_w, NOW_NS + ns(at_s)),
                    NOW_NS + ns(at_s))[0]
            for at_s, temperature_c, charged_with_w in (
                (0.0, -3.0, FAST_W), (1.0, -3.0, 10.0), (2.0, LIMIT_C - 0.1, 10.0), (3.0, -3.0, -10.0))]
    assert seen == [HEAT_W, HEAT_W, HEAT_W, 0.0]


def test_time_alone_ends_it_at_departure_and_with_the_battery_state():
    supervisor = supervisor_at(DRIVE_S + STOP_S - 3.0)
    assert outcome(supervisor, measured(-3.0, 50e3)) == CHARGING
    command = supervisor.command(NOW_NS + ns(2.9))
    assert (command.battery_heating_power_w, command.valid_until_ns) == (HEAT_W, NOW_NS + ns(5.0))
    assert supervisor.command(NOW_NS + ns(3.0)).battery_heating_power_w == 0.0
    supervisor = supervisor_at(AT_STOP_S)
    outcome(supervisor, measured(-3.0, 50e3))
    command = supervisor.command(NOW_NS + ns(5.0))
    assert (command.battery_heating_power_w, command.reason) == (0.0, Status.STALE_INPUT)


@pytest.mark.parametrize('charged_with_w, charging_planned, expected', [
    (50e3, True, CHARGING), (0.0, True, (0.0, Status.ARRIVED)), (50e3, False, (0.0, Status.ARRIVED))])
def test_it_heats_at_the_charger_at_the_end_of_the_route(charged_with_w, charging_planned, expected):
    supervisor = Stepwise(VEHICLE, ASKED)
    supervisor.accept_mission(Mission('to a charger', (make_leg(
        start_ns=NOW_NS - ns(DRIVE_S + 1.0), charging_planned=charging_planned),)))
    assert outcome(supervisor, measured(-3.0, charged_with_w)) == expected
