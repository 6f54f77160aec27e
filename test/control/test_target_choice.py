# SPDX-License-Identifier: Apache-2.0
"""The planner chooses the target for a known charger: which target, and when it searches again."""

from dataclasses import replace
import math

from charger_trips import (
    a_mission,
    a_supervisor,
    cost,
    drive,
    ENOUGH,
    FAST,
    feed,
    MEASURED,
    PRICES,
    search_input,
    SLOW,
    START_NS,
    STATE,
    target_of,
    VEHICLE,
)
import numpy as np
import pytest

from bev_preheat.charging.worth_search import find_worth
from bev_preheat.control import target_choice
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.control.target import TargetSource
from bev_preheat.control.target_choice import TargetChooser
from bev_preheat.estimation.estimate import FACTORS, HEAT_CAPACITY
from bev_preheat.estimation.prior import Learned
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.simulation.supervised_drive import moments
from bev_preheat.tunables import MOST_MOVE_K
from bev_preheat.vehicle.description import HeatPath
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

# Which target


@pytest.mark.costly
@pytest.mark.parametrize('charger, state', [
    (FAST, BatteryState(10.0, 0.2)), pytest.param(SLOW, STATE, marks=pytest.mark.deep)])
def test_the_target_costs_what_the_best_costs(charger, state):
    supervisor, route = a_supervisor(charger), drive()
    first = feed(supervisor, 0.0, state).target
    for second in range(1, ENOUGH):
        chosen = feed(supervisor, 0.5 * second, state).target
    best = find_worth(VEHICLE, route, state, Goal(25.0), charger.power_w, 0.8, PRICES).best.cost
    assert first.source is chosen.source is TargetSource.CHOSEN
    assert cost(VEHICLE, route, state, target_of(chosen), charger) <= 1.001 * best
    # The first look is at every fifth degree.
    assert cost(VEHICLE, route, state, target_of(first), charger) <= 1.005 * best
    usual = cost(VEHICLE, route, state, 25.0, charger)
    assert usual > 1.002 * best


@pytest.mark.costly
def test_it_is_chosen_for_the_car_as_it_is_known():
    # A battery that takes a quarter more heat than the file says.
    factors = np.zeros(5)
    factors[HEAT_CAPACITY - FACTORS.start] = math.log(1.25)
    learned = Learned(factors, np.diag(np.full(5, 1e-8)))
    settings = replace(MEASURED, estimation=True)
    supervisor, route, state = a_supervisor(settings=settings, learned=learned), drive(), BatteryState(-5.0, 0.5)
    for second in range(ENOUGH):
        chosen = feed(supervisor, 0.2 * second, state).target
    car = corrected_vehicle(VEHICLE, Corrections(heat_capacity=1.25))
    goal = Goal(25.0)
    best = find_worth(car, route, state, goal, 150e3, 0.8, PRICES).best
    assert cost(car, route, state, chosen.target_c, FAST) <= 1.001 * best.cost
    # The vehicle file alone would have given another answer.
    by_file = plan_unheated(VEHICLE, route, state, goal).arrival_temperature_c
    assert abs(by_file - plan_unheated(car, route, state, goal).arrival_temperature_c) > 0.5
    unheated = cost(car, route, state, None, FAST), cost(VEHICLE, route, state, None, FAST)
    told = chosen.unheated_charging_time_s * 12.0 / 3600.0 + chosen.unheated_bought_energy_wh * 0.55e-3
    assert abs(told - unheated[0]) < 0.1 * abs(told - unheated[1])


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
    _, after = chosen_after(chooser, 1400.0, np.zeros(5), nearly_full)
    worth = find_worth(VEHICLE, drive(), nearly_full, Goal(25.0), 150e3, 0.8, PRICES)
    assert worth.best is worth.without_heating
    assert before.heating_pays and not after.heating_pays


# Heat under way

def driven_with_late_heat(target_c=math.nan):
    """Drive a car whose heat arrives late; return instants [s] and powers [W] of its commands, and the target."""
    late = replace(VEHICLE, heat_path=HeatPath(45.0, 15e3, 300.0))
    car = ImperfectCar(
        late, DrivePhase(drive(20, -9.0, power_w=14e3), Goal(target_c), charger=FAST), BatteryState(10.0, 0.45),
        Imperfections(sensors=Sensors(temperature_noise_k=0.1, temperature_resolution_k=0.1, period_s=10.0)),
        [3, 14])
    supervisor = Supervisor(late, replace(
        MEASURED, estimation=True, command_period_s=10.0, command_lease_s=22.0, battery_state_timeout_s=22.0))
    commands, planned_c = [], math.nan
    for moment in moments(car, supervisor, lambda: car.is_over):
        output = moment.output
        if output.command is not None:
            commands.append((moment.time_s, output.command.battery_heating_power_w))
        if output.decision is not None and output.decision.plan is not None:
            planned_c = output.decision.plan.target_temperature_c
    return *np.array(commands).T, planned_c


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
