# SPDX-License-Identifier: Apache-2.0
"""Driving, standing and charging, from power, position and supply status."""

import random

import pytest

from bev_preheat.control.inputs import SupplyStatus
from bev_preheat.control.regime import Evidence, PlannedPower, Regime, RegimeWatch
from bev_preheat.numerics import NS_PER_S

START_S = 5000
# The route plans 15.3 kW of propulsion and 2.1 kW of consumers.
ROAD = PlannedPower(15300.0, 12000.0, 19000.0, 2100.0, 12500.0, 15000.0)
DESCENT = PlannedPower(-14000.0, -22000.0, -5000.0, 2100.0, -20000.0, -14000.0)
CITY = PlannedPower(2600.0, -900.0, 4000.0, 2100.0, 300.0, 2500.0)


def watch(powers_w, planned=ROAD, **evidence):
    """Return the instants [s] and RegimeReports of powers [W], one a second."""
    regimes, reports = RegimeWatch(), []
    for number, power_w in enumerate(powers_w):
        instant_s = START_S + number
        at = {name: value(instant_s) if callable(value) else value for name, value in {
            'command_w': 0.0, 'planned': planned, **evidence}.items()}
        regimes = regimes.seen(Evidence(instant_s * NS_PER_S, power_w, **at))
        reports.append((instant_s - START_S, regimes.report))
    return reports


def last(*args, **kwargs):
    return watch(*args, **kwargs)[-1][1]


def first_at(reports, regime):
    """Return the instant [s] at which a regime was first reported; None: never."""
    return next((instant_s for instant_s, report in reports if report.regime is regime), None)


def driven_w(seed):
    """Return powers of a drive [W] that wander over some seconds, as real ones do."""
    drawn, wander, powers_w = random.Random(seed), 0.0, []
    for _ in range(400):
        wander += -0.2 * wander + 3600.0 * drawn.gauss(0.0, 1.0)
        powers_w.append(4000.0 + wander)
    return powers_w


# Charging

@pytest.mark.parametrize('power_w', [-3600.0, -10500.0, -90000.0])
def test_charging_is_recognised_within_ten_seconds(power_w):
    reports = watch([17400.0] * 60 + [power_w] * 30)
    assert 60 + 5 < first_at(reports, Regime.CHARGING) <= 60 + 10
    report = reports[-1][1]
    assert (report.regime, report.since_ns) == (Regime.CHARGING, (START_S + 60) * NS_PER_S)
    assert f'{-power_w:.0f} W' in report.evidence


RAMP_W = [-1500.0 - 6000.0 * second for second in range(15)]


@pytest.mark.parametrize('powers_w, planned, within_s', [
    ([17400.0] * 30 + RAMP_W + RAMP_W[-1:] * 20, ROAD, 30 + 15 + 10), ([-60000.0] * 30, DESCENT, 10)],
    ids=['a ramp to full power', 'far more than the descent gives'])
def test_charging_is_recognised_once_it_is_steady_also_on_a_descent(powers_w, planned, within_s):
    assert first_at(watch(powers_w, planned), Regime.CHARGING) <= within_s


@pytest.mark.parametrize('least_in_60_s_w, within_s', [(100.0, 60 + 61), (-5900.0, None)])
def test_a_slow_charger_where_the_route_brakes_is_recognised_within_a_minute(least_in_60_s_w, within_s):
    """Segments give 11 kW, each for some seconds: a charge of 6 kW that lasts is no braking."""
    town = PlannedPower(2600.0, -11000.0, 12000.0, 2100.0, least_in_60_s_w, 3500.0)
    at_s = first_at(watch([17400.0] * 60 + [-6000.0] * 90, town), Regime.CHARGING)
    assert at_s is None if within_s is None else 60 + 60 <= at_s <= within_s


# From 35 m/s to rest in 18 s: the power falls with the speed.
BRAKING_W = [-1500.0 * speed for speed in range(35, 0, -2)]


@pytest.mark.parametrize('powers_w, planned, regime', [
    (([17400.0] * 20 + BRAKING_W) * 5, ROAD, Regime.CHARGING),
    *(([power_w] * 600, DESCENT, Regime.CHARGING) for power_w in (-12000.0, -20000.0, -40000.0)),
    (([17400.0] * 30 + [2200.0] * 50) * 5, ROAD, Regime.STANDING),
    (([2200.0] * 25 + [6000.0] * 5) * 30, ROAD, Regime.STANDING)],
    ids=['braking', 'gentle descent', 'descent', 'steep descent', 'red light', 'stop and go'])
def test_braking_and_a_descent_are_no_charging_and_short_stops_no_standing(powers_w, planned, regime):
    assert first_at(watch(powers_w, planned), regime) is None


def test_a_drive_is_no_charging_and_no_standing():
    for seed in range(20):
        regimes = {report.regime for _, report in watch(driven_w(seed))}
        assert regimes == {Regime.DRIVING}


def test_a_status_tells_charging_from_regeneration():
    said = {'supply': SupplyStatus.CHARGING}
    unsteady = [-5000.0, -9000.0] * 10
    assert last(unsteady).regime is Regime.DRIVING
    assert last(unsteady, **said).regime is Regime.CHARGING
    # Many batteries report this whenever current flows in, also downhill.
    assert last(unsteady, DESCENT, **said).regime is Regime.DRIVING
    assert last([-9000.0] * 20, supply=SupplyStatus.DISCHARGING).regime is Regime.DRIVING


@pytest.mark.parametrize('supply', [SupplyStatus.DISCHARGING, SupplyStatus.NOT_CHARGING])
def test_a_status_that_never_changes_hides_a_charger_for_a_minute_at_most(supply):
    assert 60 < first_at(watch([17400.0] * 60 + [-50000.0] * 90, supply=supply), Regime.CHARGING) <= 60 + 61
    # A descent on no map, in bends.
    bends_w = [17400.0] * 60 + [-30000.0 + 400.0 * (at_s % 20) for at_s in range(200)]
    assert first_at(watch(bends_w, supply=supply), Regime.CHARGING) is None


@pytest.mark.parametrize('is_known', [True, False], ids=['power', 'status alone'])
def test_a_status_that_told_braking_tells_no_descent_but_a_charger(is_known):
    # It brakes for 5 s in each 20 s, rolls down a hill for 40 s, and charges unsteadily at last.
    powers_w = ([17400.0] * 15 + [-20000.0] * 5) * 3 + [-8000.0, -15000.0] * 20 + [17400.0] * 20
    powers_w += [-2000.0, -9000.0] * 60
    reports = watch(powers_w if is_known else [None] * len(powers_w), supply=lambda at_s: (
        SupplyStatus.CHARGING if powers_w[at_s - START_S] < 0.0 else SupplyStatus.DISCHARGING))
    assert 120 + 60 <= first_at(reports, Regime.CHARGING) <= 120 + 61


@pytest.mark.parametrize('step', [0.001, 0.005, 0.01])
def test_a_status_that_the_falling_charge_contradicts_is_no_charging(step):
    # 17.4 kW take 1 % in 155 s.
    reports = watch_charges([(1800, 17400.0)], step=step, supply=SupplyStatus.CHARGING)
    charging_s = [at_s for at_s, report in reports if report.regime is Regime.CHARGING]
    assert charging_s[-1] < 400
    # Plugged in at last, its charge rises.
    reports = watch_charges([(1800, 17400.0), (300, -50000.0)], step=step, supply=SupplyStatus.CHARGING)
    assert reports[-1][1].regime is Regime.CHARGING


def test_a_status_counts_from_its_first_word_on_whatever_was_driven_before():
    reports = watch_charges([(900, 17400.0), (60, -3000.0)], supply=lambda at_s: (
        SupplyStatus.CHARGING if at_s >= START_S + 900 else SupplyStatus.DISCHARGING))
    assert 900 < first_at(reports, Regime.CHARGING) <= 910


def test_a_status_counts_without_voltage_and_current():
    assert last([None] * 20).regime is Regime.UNKNOWN
    assert last([None] * 20, supply=SupplyStatus.CHARGING).regime is Regime.CHARGING
    assert last([None] * 20, DESCENT, supply=SupplyStatus.CHARGING).regime is Regime.UNKNOWN
    ended = watch([None] * 40, supply=lambda at_s: (
        SupplyStatus.CHARGING if at_s < START_S + 20 else SupplyStatus.NOT_CHARGING))
    assert ended[-1][1].regime is not Regime.CHARGING


def test_after_charging_it_stands_and_then_drives():
    reports = watch([-50000.0] * 60 + [1500.0] * 60 + [17400.0] * 10)
    at = dict(reports)
    assert at[59].regime is Regime.CHARGING
    assert at[70].regime is Regime.STANDING
    assert first_at(reports[60:], Regime.DRIVING) <= 120 + 5


def test_a_charger_that_pauses_for_two_seconds_goes_on():
    reports = watch([-50000.0] * 60 + [0.0] * 2 + [-50000.0] * 20)
    assert {report.regime for at_s, report in reports if at_s > 10} == {Regime.CHARGING}


def test_a_power_that_mirrors_the_route_is_suspected_only_while_the_sign_is_not_proven():
    report = last([-17400.0] * 30, is_sign_proven=False)
    assert report.regime is not Regime.CHARGING
    assert 'sign of battery_state.current may be reversed' in report.suspicion
    assert last([-17400.0] * 30).regime is Regime.CHARGING
    # It continues while the current varies, until current flows out.
    assert last([-17400.0] * 30 + [-6000.0, -30000.0] * 10, is_sign_proven=False).suspicion
    assert not last([-17400.0] * 30 + [9000.0] * 2, is_sign_proven=False).suspicion
    assert last([-90000.0] * 30, is_sign_proven=False).regime is Regime.CHARGING


# Standing

def test_standing_is_recognised_after_a_minute():
    reports = watch([17400.0] * 100 + [2200.0] * 100)
    assert 100 + 59 <= first_at(reports, Regime.STANDING) <= 100 + 62
    report = reports[-1][1]
    assert report.since_ns == pytest.approx((START_S + 100) * NS_PER_S, abs=2 * NS_PER_S)
    assert not report.is_parked and 'the route plans 17400 W' in report.evidence


def test_where_the_route_plans_little_power_a_stand_takes_longer():
    # A minute may be a stop that the route plans, 5 min are not.
    assert first_at(watch([2000.0] * 400, CITY), Regime.STANDING) == pytest.approx(300, abs=2)
    # Downhill a vehicle may take no more than its consumers for as long as the descent lasts.
    assert first_at(watch([2000.0] * 900, DESCENT), Regime.STANDING) is None


@pytest.mark.parametrize('planned', [CITY, DESCENT])
def test_with_its_consumers_off_no_vehicle_drives(planned):
    reports = watch([400.0] * 200, planned)
    assert first_at(reports, Regime.STANDING) == pytest.approx(120, abs=2)
    report = reports[-1][1]
    assert report.is_parked and report.since_ns == pytest.approx(START_S * NS_PER_S, abs=2 * NS_PER_S)


@pytest.mark.parametrize('power_w, is_parked', [(2100.0, False), (1500.0, False), (500.0, True), (0.0, True)])
def test_a_vehicle_whose_consumers_are_off_is_parked(power_w, is_parked):
    # The heater takes 5 kW until it receives 0 W.
    report = last([power_w + 5000.0] * 90, command_w=5000.0)
    assert (report.regime, report.is_parked) == (Regime.STANDING, is_parked)


def test_a_position_tells_standing_without_voltage_and_current():
    stood = watch([None] * 100, has_moved=False, stood_s=lambda at_s: at_s - START_S)
    assert first_at(stood, Regime.STANDING) == 60
    assert stood[-1][1].since_ns == pytest.approx(START_S * NS_PER_S, abs=NS_PER_S)


# Without power and position: the state of charge alone, of a battery of 75 kWh

FULL_J = 270e6


def charges(powers_w, step=0.001, soc=0.4, noise=0.0):
    """Return a function from instants [s] to the charges that (duration [s], power [W]) leave, in steps."""
    drawn, socs = random.Random(5), []
    for duration_s, power_w in powers_w:
        for _ in range(duration_s):
            soc -= power_w / FULL_J
            shown = soc + noise * drawn.gauss(0.0, 1.0)
            socs.append(round(shown / step) * step if step else shown)
    return lambda at_s: socs[round(at_s - START_S)]


def watch_charges(powers_w, planned=ROAD, step=0.001, noise=0.0, soc=0.4, **evidence):
    return watch([None] * sum(duration_s for duration_s, _ in powers_w), planned, soc=charges(
        powers_w, step, soc, noise), full_j=FULL_J, **evidence)


@pytest.mark.parametrize('step, within_s', [(0.001, 100), (0.005, 115), (0.01, 130)])
def test_a_charge_that_rises_tells_charging(step, within_s):
    # 100 kW: 3 % in 81 s.
    reports = watch_charges([(900, 17400.0), (200, -100000.0)], step=step)
    assert 980 <= first_at(reports, Regime.CHARGING) <= 900 + within_s
    since_s = reports[-1][1].since_ns / NS_PER_S - START_S
    assert 870 <= since_s <= 930
    # Nothing is learned from the rise before it is recognised.
    doubtful_s = next(at_s for at_s, report in reports if report.is_doubtful)
    assert 900 < doubtful_s < 900 + within_s / 2 + 10


def test_a_position_that_is_frozen_while_the_battery_drives_is_no_stand():
    # A receiver that repeats its latest position: the regime must not change with each state.
    frozen = {'has_moved': False, 'stood_s': lambda at_s: at_s - START_S}
    assert {report.regime for _, report in watch([17400.0, 14000.0] * 150, **frozen)[60:]} == {Regime.DRIVING}
    assert last([2100.0, 2500.0] * 60, **frozen).regime is Regime.STANDING


def test_charging_by_the_charge_ends_when_it_falls_or_stays():
    driven = watch_charges([(900, 17400.0), (200, -100000.0), (300, 17400.0)])
    assert 1100 <= max(at_s for at_s, report in driven if report.regime is Regime.CHARGING) <= 1100 + 110
    assert driven[-1][1].regime is Regime.UNKNOWN
    full = dict(watch_charges([(200, -100000.0), (400, 0.0)], step=0.01))
    assert full[450].regime is Regime.CHARGING and full[599].regime is Regime.STANDING


@pytest.mark.parametrize('powers_w, how', [
    ([(3000, 17400.0)], {'step': 0.0, 'noise': 0.002}), ([(3000, 6000.0)], {'step': 0.01}),
    ([(3000, 5000.0)], {'planned': CITY}), ([(290, -20000.0)], {'planned': DESCENT}),
    ([(290, -30000.0)], {'planned': DESCENT, 'step': 0.01}), ([(290, -22000.0)], {'step': 0.01}),
    # The true charge goes on falling.
    ([(1500, 0.0)], {'soc': 0.995}), ([(1500, 0.0)], {'soc': 0.008}),
    ([(400, 17400.0), (1, -0.05 * FULL_J), (400, 17400.0)], {}), ([(1800, 17400.0)], {'command_w': 6000.0}),
    ([(300, -50000.0)], {'supply': SupplyStatus.DISCHARGING})], ids=[
        'noise', 'whole percent', 'city', 'descent', 'descent in whole percent', 'descent on no map',
        'display at its upper end', 'display at its lower end', 'corrected display',
        'heater that does not follow', 'status of a discharge'])
def test_what_shows_neither_charging_nor_standing_leaves_the_regime_unknown(powers_w, how):
    assert {report.regime for _, report in watch_charges(powers_w, **how)} == {Regime.UNKNOWN}


def test_a_display_that_is_renewed_every_five_minutes_is_no_standing():
    shown = charges([(3000, 10000.0)])
    reports = watch([None] * 3000, soc=lambda at_s: shown(START_S + (at_s - START_S) // 300 * 300), full_j=FULL_J)
    assert {report.regime for _, report in reports} == {Regime.UNKNOWN}


@pytest.mark.parametrize('step, within_s', [(0.001, 6 * 60), (0.01, 30 * 60)])
@pytest.mark.parametrize('command_w', [0.0, 5000.0])
def test_a_charge_that_stays_tells_standing(step, within_s, command_w):
    # The route takes 15 kW, the vehicle 1 kW and the heater's command.
    reports = watch_charges([(900, 17400.0), (1800, 1000.0 + command_w)], step=step,
                            command_w=command_w)
    assert 900 + 120 <= first_at(reports, Regime.STANDING) <= 900 + within_s
    assert reports[-1][1].regime is Regime.STANDING
    assert reports[-1][1].evidence == 'the state of charge hardly falls on a route that takes from it'


def test_a_slow_stretch_after_a_fast_one_is_no_standing():
    # 40 kW, then 6 min with a sixteenth; the route's least mean of 300 s follows late, as a mean does.
    powers_w = [40000.0] * 600 + [2500.0] * 360 + [20000.0] * 600

    def planned(at_s):
        number = at_s - START_S
        least_w = sum(powers_w[max(0, number - 299):number + 1]) / 300.0
        return PlannedPower(least_w, 0.0, 40000.0, 2100.0, 0.0, least_w)

    reports = watch_charges([(1, power_w) for power_w in powers_w], planned)
    assert {report.regime for _, report in reports} == {Regime.UNKNOWN}


def test_a_silence_ends_what_was_known():
    regimes = RegimeWatch()
    for second in range(30):
        regimes = regimes.seen(Evidence((START_S + second) * NS_PER_S, -50000.0, 0.0, ROAD))
    assert regimes.report.regime is Regime.CHARGING
    for silence_s in (32400, -30):
        driven = regimes.seen(Evidence((START_S + 30 + silence_s) * NS_PER_S, 17400.0, 0.0, ROAD))
        assert driven.report.regime is Regime.DRIVING
