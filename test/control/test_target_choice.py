# SPDX-License-Identifier: Apache-2.0
"""The target for a known charger: which the planner chooses, when it searches again, and when none is chosen."""

from dataclasses import replace
import math
from types import SimpleNamespace

import numpy as np
import pytest
import simulated_drives
from stepwise import Stepwise

from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.stop import Charger, ChargingStop
from bev_preheat.charging.target_worth import Prices, TargetWorth
from bev_preheat.charging.worth_search import find_worth
from bev_preheat.control import target_choice
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.target import TargetSource
from bev_preheat.control.target_choice import TargetChooser, TargetSearchInput
from bev_preheat.estimation.estimate import FACTORS, HEAT_CAPACITY
from bev_preheat.estimation.prior import Learned
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route import Route
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.tunables import LEAST_GAIN_SHARE, MOST_MOVE_K
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

VEHICLE = load_vehicle('reference')
START_NS = 1_700_000_000 * NS_PER_S
PRICES = Prices(0.55, 12.0)
MEASURED = Settings(estimation=False, energy_price_per_kwh=0.55, value_of_time_per_h=12.0)
FAST, SLOW = Charger(150e3, 0.8), Charger(50e3, 0.8)
STATE = BatteryState(6.0, 0.35)
# Enough updates for any search, with one plan each.
ENOUGH = 85


def drive(minutes=25, ambient_c=-8.0, power_w=15e3):
    """Return a Route of one-minute steps at 90 km/h."""
    return Route(np.full(minutes, 60.0), *(np.full(minutes, value) for value in (
        25.0, power_w, power_w, ambient_c, 1500.0, 400.0, power_w)))


def a_mission(charger=FAST, route_id='home', route=None, start_ns=START_NS, **leg):
    return Mission(route_id, (Leg(route or drive(), start_ns, charger=charger, **leg),))


def a_supervisor(charger=FAST, settings=MEASURED, vehicle=VEHICLE, learned=None, **mission):
    supervisor = Stepwise(vehicle, settings, learned)
    supervisor.run(START_NS)
    supervisor.accept_mission(a_mission(charger, **mission))
    return supervisor


def feed(supervisor, at_s=0.0, state=STATE):
    now_ns = START_NS + round(at_s * NS_PER_S)
    supervisor.accept_battery(Measurement(state, now_ns), now_ns)
    return supervisor.state.decision


def cost(vehicle, route, state, target_c, charger):
    """Return the cost of a target (None: no heating), computed from plan, session and prices."""
    goal = Goal(20.0 if target_c is None else target_c)
    plan = (plan_unheated if target_c is None else plan_preheating)(vehicle, route, state, goal)
    stop = ChargingStop(charger.power_w, charger.departure_soc, float(route.ambient_temperature_c[-1]),
                        float(route.cabin_heating_power_w[-1]), float(route.auxiliary_power_w[-1]))
    heating = ChargerHeating(vehicle, stop, PRICES)
    unheated = plan_unheated(vehicle, route, state, goal)
    # The unheated arrival comes first, as in the search: the heat at the charger is fitted to it.
    for arrived in (unheated, plan):
        session = heating.choose(BatteryState(arrived.arrival_temperature_c, arrived.arrival_soc)).session
    return (PRICES.energy_per_kwh * session.bought_energy_wh / 1000.0
            + PRICES.time_per_h * session.charging_time_s / 3600.0)


def target_of(choice):
    return choice.target_c if choice.heating_pays else None


def search_input(at_s, factors=(0.0, 0.0, 0.0, 0.0, 0.0), state=STATE):
    """Return the search input of the decision maker, for a car with these logarithms of its factors."""
    leg, = a_mission().legs
    car = corrected_vehicle(VEHICLE, Corrections(*np.exp(factors[:4]).tolist()))
    return TargetSearchInput('home', 0, leg, MEASURED, Goal(25.0), car, drive().with_propulsion(
        math.exp(factors[4])), state, START_NS + round(at_s * NS_PER_S))


# The last battery takes a quarter more heat than the file says, and that was learned.
@pytest.mark.costly
@pytest.mark.parametrize('charger, state, heat_capacity', [
    (FAST, BatteryState(10.0, 0.2), 1.0), pytest.param(SLOW, STATE, 1.0, marks=pytest.mark.deep),
    (FAST, BatteryState(-5.0, 0.5), 1.25)], ids=['fast', 'slow', 'learned'])
def test_the_target_costs_what_the_best_costs_for_the_car_as_it_is_known(charger, state, heat_capacity):
    factors = np.zeros(6)
    factors[HEAT_CAPACITY - FACTORS.start] = math.log(heat_capacity)
    supervisor, route = a_supervisor(charger, replace(MEASURED, estimation=heat_capacity != 1.0), learned=Learned(
        factors, np.diag(np.full(6, 1e-8)))), drive()
    first = feed(supervisor, 0.0, state).target
    for second in range(1, ENOUGH):
        chosen = feed(supervisor, 0.2 * second, state).target
    car = corrected_vehicle(VEHICLE, Corrections(heat_capacity=heat_capacity))
    best = find_worth(car, route, state, Goal(25.0), charger.power_w, 0.8, PRICES).best.cost
    assert first.source is chosen.source is TargetSource.CHOSEN
    assert cost(car, route, state, target_of(chosen), charger) <= 1.001 * best
    # The first look is at every fifth degree.
    assert cost(car, route, state, target_of(first), charger) <= 1.005 * best
    if heat_capacity == 1.0:
        assert cost(car, route, state, 25.0, charger) > 1.002 * best
        return
    # The vehicle file alone would have given another answer.
    known, by_file = (cost(each, route, state, None, charger) for each in (car, VEHICLE))
    told = chosen.unheated_charging_time_s * 12.0 / 3600.0 + chosen.unheated_bought_energy_wh * 0.55e-3
    assert abs(told - known) < 0.1 * abs(told - by_file) > 0.0


# Time and duration of a search

@pytest.mark.costly
def test_no_update_makes_more_than_a_plan(monkeypatch):
    plans = []

    def counted(*arguments, **options):
        plans.append(arguments)
        return plan_preheating(*arguments, **options)

    monkeypatch.setattr(target_choice, 'plan_preheating', counted)
    supervisor, counts = a_supervisor(), []
    for second in range(ENOUGH):
        plans.clear()
        feed(supervisor, 0.5 * second)
        counts.append(len(plans))
    assert 3 <= counts[0] <= 7 and max(counts[1:]) == 1
    # After the target is found, no search runs.
    assert 40 < sum(counts) < 95 and sum(counts[-3:]) == 0


@pytest.mark.costly
def test_an_update_of_the_route_keeps_the_target_until_it_is_searched_through():
    supervisor = a_supervisor()
    for second in range(ENOUGH):
        before = feed(supervisor, second).target
    supervisor.accept_mission(a_mission(route=drive(power_w=16e3)))
    assert feed(supervisor, ENOUGH).target is before
    for second in range(1, ENOUGH):
        after = feed(supervisor, ENOUGH + second).target
    assert after is not before
    assert after.unheated_charging_time_s != before.unheated_charging_time_s


@pytest.mark.parametrize('other', [
    pytest.param({'charger': SLOW}, marks=pytest.mark.deep), {'route_id': 'another'},
    {'target_temperature_c': 21.0}, {'minimum_arrival_soc': 0.1}])
def test_another_goal_is_answered_at_once(other):
    supervisor = a_supervisor()
    before = feed(supervisor).target
    supervisor.accept_mission(a_mission(**other))
    assert feed(supervisor, 1.0).target is not before


def chosen_after(chooser, at_s, *belief):
    """Return the chooser and its TargetChoice at the end of a search that begins at `at_s` [s]."""
    for plans in range(ENOUGH):
        chooser, choice = chooser.choose(search_input(at_s + 0.01 * plans, *belief))
    return chooser, choice


@pytest.mark.costly
def test_a_belief_that_has_really_changed_changes_the_target():
    chooser, before = chosen_after(TargetChooser(), 0.0)
    # A charge that turns out to be almost enough; a repeated state changes nothing.
    chooser, repeated = chosen_after(chooser, 700.0)
    assert repeated.target_c == before.target_c
    nearly_full = BatteryState(6.0, 0.82)
    _, after = chosen_after(chooser, 1400.0, np.zeros(6), nearly_full)
    worth = find_worth(VEHICLE, drive(), nearly_full, Goal(25.0), 150e3, 0.8, PRICES)
    assert worth.best is worth.without_heating
    assert before.heating_pays and not after.heating_pays


# Heat under way

def driven_with_late_heat(target_c=math.nan):
    """Drive a car whose heat arrives late; return instants [s] and powers [W] of its commands, and the target."""
    seen = list(simulated_drives.drive(
        replace(VEHICLE, heat_path=HeatPath(45.0, 15e3, 300.0)),
        DrivePhase(drive(20, -9.0, power_w=14e3), Goal(target_c), charger=FAST), BatteryState(10.0, 0.45),
        sensors=Sensors(temperature_noise_k=0.1, temperature_resolution_k=0.1, period_s=10.0), seed=[3, 14],
        energy_price_per_kwh=0.55, value_of_time_per_h=12.0, command_period_s=10.0, command_lease_s=22.0,
        battery_state_timeout_s=22.0))
    planned_c = next(each.decision.plan.target_temperature_c for each in reversed(seen) if each.decision.plan)
    return *np.array([(each.at_s, each.command.battery_heating_power_w) for each in seen]).T, planned_c


@pytest.mark.costly
def test_a_chosen_target_is_heated_for_longer_than_the_same_target_given():
    """Heat under way reaches the battery at the charger."""
    time_s, chosen_w, target_c = driven_with_late_heat()
    _, given_w, same_c = driven_with_late_heat(target_c)
    assert same_c == target_c
    for power_w in (chosen_w, given_w):
        assert np.count_nonzero(np.diff((power_w > 0.0).astype(int)) == 1) <= 2
    # In the last minutes before the arrival.
    last = time_s >= time_s[-1] - 300.0
    assert np.count_nonzero(chosen_w[last]) > 3 * np.count_nonzero(given_w[last])


class LaggingCar:
    """Core and surface of a battery in steps of 1 s; the sensor lags by a minute and has steps of 0.5 K."""

    def __init__(self, supervisor):
        self.supervisor, self.at_s = supervisor, 0
        self.core_c = self.surface_c = self.sensor_c = -8.0
        self.targets, self.commands_w = [], []

    def go(self, seconds):
        for _ in range(seconds):
            command_w = self.supervisor.state.latest_command.battery_heating_power_w if self.at_s else 0.0
            self.surface_c += (0.8 * command_w + 900.0 * (self.core_c - self.surface_c)) / 80e3
            self.core_c += (900.0 * (self.surface_c - self.core_c) + 1800.0 - 55.0 * (self.core_c + 8.0)) / 330e3
            self.sensor_c += (0.8 * self.core_c + 0.2 * self.surface_c - self.sensor_c) / 60.0
            self.at_s += 1
            decision = feed(self.supervisor, self.at_s, BatteryState(
                round(2.0 * self.sensor_c) / 2.0, 0.35 - self.at_s * 6e-5))
            self.targets.append(target_of(decision.target))
            self.commands_w.append(self.supervisor.state.latest_command.battery_heating_power_w)


@pytest.mark.costly
def test_with_a_lagging_sensor_the_target_moves_and_does_not_swing():
    car = LaggingCar(a_supervisor(settings=Settings(energy_price_per_kwh=0.55, value_of_time_per_h=12.0)))
    # The first look at every fifth degree, and the first whole search.
    car.go(ENOUGH)
    first = len(car.targets)
    car.go(100)
    # Another route plan to the same charger, as after a detour; then as an update.
    for number, route_id in enumerate(('around', 'around')):
        minutes = 25 - car.at_s // 60 + 2 - number
        car.supervisor.accept_mission(a_mission(
            route_id=route_id, route=drive(minutes), start_ns=START_NS + car.at_s * 1_000_000_000))
        car.go(100)
    later = car.targets[first - 1:]
    assert None not in later
    moves = [after - before for before, after in zip(later, later[1:]) if after != before]
    assert all(abs(move_k) <= MOST_MOVE_K + 1e-6 for move_k in moves)
    # It does not move to and fro, and the heater stays on.
    assert sum(a * b < 0.0 for a, b in zip(moves, moves[1:])) <= 1
    assert min(car.commands_w[60:]) > 0.0


# No target is chosen

@pytest.mark.parametrize('leg, settings', [
    ({'target_temperature_c': 21.0}, MEASURED), ({}, replace(MEASURED, target_battery_temperature_c=21.0))],
    ids=['by the route', 'by the parameter'])
def test_a_given_target_is_kept(leg, settings):
    supervisor = a_supervisor(settings=settings, **leg)
    for second in range(3):
        decision = feed(supervisor, second)
        assert decision.plan.target_temperature_c == 21.0
    choice = decision.target
    assert choice.source is TargetSource.GIVEN and ('route plan' in choice.reason) is bool(leg)
    assert choice.charging_time_s * 12.0 / 3600.0 + choice.bought_energy_wh * 0.55e-3 == pytest.approx(
        cost(VEHICLE, drive(), STATE, 21.0, FAST), rel=1e-9)


@pytest.mark.parametrize('settings', [MEASURED, Settings()], ids=['measured', 'estimated'])
@pytest.mark.parametrize('vehicle, charger, why', [
    (VEHICLE, None, "does not say the charger's power"),
    (replace(VEHICLE, charging=None), FAST, 'charging.battery_heating is missing')], ids=['charger', 'vehicle'])
def test_without_charger_or_car_everything_is_as_without_them(vehicle, charger, why, settings):
    supervisors = a_supervisor(charger, settings, vehicle), a_supervisor(
        None, settings, vehicle, target_temperature_c=25.0)
    for second in range(3):
        decision, other = (feed(supervisor, second) for supervisor in supervisors)
        assert (decision.status, decision.explanation) == (other.status, other.explanation)
        for name in ('time_s', 'battery_temperature_c', 'soc', 'hvch_battery_power_w'):
            assert np.array_equal(getattr(decision.plan, name), getattr(other.plan, name))
    assert decision.target.source is TargetSource.DEFAULT and why in decision.target.reason
    assert math.isnan(decision.target.charging_time_s)


@pytest.mark.parametrize('charger, state, why', [
    (Charger(150e3), BatteryState(6.0, 0.95), 'the state of charge for departure is unknown'),
    (Charger(150e3, 0.01), BatteryState(6.0, 0.08), 'is not enough for this trip'),
    (Charger(1800.0, 0.8), STATE, 'cannot charge the battery that far')],
    ids=['full enough', 'stranded', 'too weak'])
def test_where_nothing_can_be_chosen_the_default_holds(charger, state, why):
    decision = feed(a_supervisor(charger), state=state)
    assert decision.target.source is TargetSource.DEFAULT
    assert why in decision.target.reason and decision.plan.target_temperature_c == 25.0


def test_without_charging_nothing_is_chosen():
    decision = feed(a_supervisor(charging_planned=False))
    assert decision.status is Status.NO_CHARGING_PLANNED and decision.target is None


# Not worth it

def test_where_heating_does_not_pay_there_is_none():
    supervisor = a_supervisor(SLOW)
    decision = feed(supervisor)
    worth = find_worth(VEHICLE, drive(), STATE, Goal(25.0), 50e3, 0.8, PRICES)
    assert worth.best is worth.without_heating
    assert decision.status is supervisor.state.latest_command.reason is Status.NOT_WORTH_IT
    assert supervisor.state.latest_command.battery_heating_power_w == 0.0
    assert decision.explanation.startswith(worth.verdict.split(':')[0])
    assert 'The heater stays off: arrival in 25:00 min' in decision.explanation
    plan, target = decision.plan, worth.without_heating.target_c
    assert plan.target_temperature_c == plan.arrival_temperature_c == pytest.approx(target)
    assert plan.heating_start_s is None and plan.shortfall_k == 0.0


def test_a_battery_with_more_than_is_asked_for_is_not_heated():
    decision = feed(a_supervisor(Charger(150e3, 0.6)), state=BatteryState(6.0, 0.9))
    assert decision.status is Status.NOT_WORTH_IT and 'needs no charging' in decision.explanation
    assert (decision.target.charging_time_s, decision.target.bought_energy_wh) == (0.0, 0.0)


def test_a_gain_that_is_too_small_is_none():
    without = TargetWorth(5.0, 5.0, 0.2, 0.0, 1800.0, 40e3, 30.0)
    little = replace(without, target_c=8.0, arrival_temperature_c=8.0, cost=30.0 - 0.9 * LEAST_GAIN_SHARE * 30.0)

    search = SimpleNamespace(way='heating', without=without, best=lambda: little, break_even_per_h=lambda: 7.125,
                             step_in_words=lambda: 'A step.')
    _, choice = TargetChooser().best_of(search, search_input(0.0))
    assert not choice.heating_pays and choice.target_c is None
    assert choice.reason == (
        'Not worth it: heating the battery to 8.0 degC before arrival would save less than 0.05 % of the '
        'cost. Some heating pays as soon as an hour is worth 7.12 to you. A step.')


def test_a_trip_that_cannot_be_carried_says_so_first():
    decision = feed(a_supervisor(SLOW), state=BatteryState(6.0, 0.08))
    assert decision.status is Status.OUT_OF_CHARGE


def test_each_leg_has_the_target_for_its_own_charger():
    legs = [Leg(drive(), START_NS, charger=FAST),
            Leg(drive(), START_NS + 2100 * NS_PER_S, departure=BatteryState(6.0, 0.35), charger=SLOW)]
    supervisor = Stepwise(VEHICLE, MEASURED)
    supervisor.run(START_NS)
    supervisor.accept_mission(Mission('far', tuple(legs)))
    first = feed(supervisor)
    assert first.target.heating_pays
    assert feed(supervisor, 1800.0).target is None
    second = feed(supervisor, 2100.0)
    assert second.leg is legs[1] and second.status is Status.NOT_WORTH_IT
