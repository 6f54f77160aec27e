# SPDX-License-Identifier: Apache-2.0
"""Plans and commands in messages: figures, instants, unknown values; the numbers of enumerations."""

from dataclasses import replace
from math import inf, nan
from pathlib import Path
import re
from types import SimpleNamespace

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from stepwise import Stepwise

from bev_preheat.control.decision import Decision
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.target import TargetSource
from bev_preheat.messages.diagnostics import planner_diagnostics
from bev_preheat.messages.fields import nanoseconds
from bev_preheat.messages.preheat_plan import charging_text, plan_message, temperature_message
from bev_preheat.messages.route_plan import mission_from_message
from bev_preheat.monitoring.seen import plan_seen
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.schedule import HeatingInterval, Reason, Stranding
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

VEHICLE = load_vehicle('reference')
EAST = Mission('east', (Leg(None),))
START_S = 1_700_000_000
STATE = BatteryState(6.0, 0.4375)
MESSAGES = Path(__file__).parents[2] / 'msg_defs' / 'msg'


@pytest.fixture(scope='module')
def decision():
    route = make_route({
        'duration_s': [30.0] * 40, 'speed_mps': [20.0], 'propulsion_power_w': [20e3],
        'ambient_temperature_c': [-7.0]}, VEHICLE.defaults)
    plan = plan_preheating(VEHICLE, route, BatteryState(18.0, 0.8), Goal(24.0))
    assert 0.0 < plan.heating_start_s < 1200.0
    return Decision(plan.status, plan.explanation, plan, 50 * NS_PER_S)


def message_of(decision, **changes):
    """Return the PreheatPlan of a Decision whose plan has other fields."""
    return plan_message(replace(decision, plan=replace(decision.plan, **changes)), EAST, now_ns=99 * NS_PER_S)


# Four heating intervals, one for each reason, all figures different.
STRETCHES = (HeatingInterval(10.0, 15.5, 7.25, Reason.CLIMB),
             HeatingInterval(30.0, 90.0, 61.0, Reason.DESCENT),
             HeatingInterval(90.0, 400.0, 330.5, Reason.SURPLUS),
             HeatingInterval(777.0, 1200.0, 590.75, Reason.ARRIVAL))


@pytest.mark.parametrize('field, expected', [
    ('stretch_start', [10.0, 30.0, 90.0, 777.0]), ('stretch_end', [15.5, 90.0, 400.0, 1200.0]),
    ('stretch_energy', [7.25, 61.0, 330.5, 590.75]),
    ('stretch_reason', [PreheatPlan.STRETCH_CLIMB, PreheatPlan.STRETCH_DESCENT, PreheatPlan.STRETCH_SURPLUS,
                        PreheatPlan.STRETCH_ARRIVAL])])
def test_heating_intervals_of_a_plan(decision, field, expected):
    for intervals, values in ((STRETCHES, expected), ((), [])):
        assert list(getattr(message_of(decision, intervals=intervals), field)) == values
    assert not len(getattr(plan_message(Decision(Status.DISABLED, 'No.'), None, now_ns=7 * NS_PER_S), field))


def test_where_the_charge_runs_out(decision):
    stranded = message_of(decision, stranding=Stranding(at_s=450.5, at_m=8125.0, deficit_wh=2250.0))
    # The plan starts at 50 s.
    assert (nanoseconds(stranded.charge_runs_out), stranded.charge_runs_out_distance,
            stranded.lacking_energy) == (500.5 * NS_PER_S, 8125.0, 2250.0)
    message = message_of(decision)
    assert message.charge_runs_out == Time()
    assert np.isnan([message.charge_runs_out_distance, message.lacking_energy]).all()


def test_without_a_plan_the_figures_are_unknown():
    message = plan_message(Decision(Status.DISABLED, 'No.'), None, now_ns=7 * NS_PER_S)
    figures = [name for name, kind in PreheatPlan.get_fields_and_field_types().items()
               if kind == 'double' and name not in ('delay', 'planning_time')]
    assert (len(figures), [name for name in figures if not np.isnan(getattr(message, name))],
            message.route_id, message.heating_planned, len(message.time), message.header.stamp,
            message.arrival) == (22, [], '', False, 0, Time(sec=7), Time())


@pytest.mark.parametrize('asked_c, told_c', [(inf, nan), (36.5, 36.5), (0.0, 0.0)])
def test_the_highest_temperature_on_arrival_if_one_is_asked_for(decision, asked_c, told_c):
    told = message_of(decision, maximum_arrival_temperature_c=asked_c)
    assert told.maximum_arrival_temperature == pytest.approx(told_c, nan_ok=True)


@pytest.mark.parametrize('deviation_k, variance', [(nan, 0.0), (0.75, 0.5625)])
def test_predicted_temperature(decision, deviation_k, variance):
    unsure = replace(decision, forecast=SimpleNamespace(deviation_k=deviation_k))
    message = temperature_message(unsure, now_ns=8 * NS_PER_S)
    assert (message.temperature, message.variance, message.header.stamp) == (
        decision.plan.arrival_temperature_c, variance, Time(sec=8))
    assert plan_message(unsure, EAST, 0).predicted_arrival_temperature_deviation == pytest.approx(
        deviation_k, nan_ok=True)


def test_later_legs_in_the_plan(decision):
    plan = decision.plan
    waits = replace(plan, heating_start_s=777.0)
    idles = replace(plan, heating_start_s=None)
    # At a stop no plan exists for now, but some for later.
    for now in (Decision(Status.WAITING, '', plan, 50 * NS_PER_S), Decision(Status.CHARGING, '')):
        message = plan_message(
            now, EAST, 99 * NS_PER_S,
            (Decision(Status.WAITING, '', waits, 5000 * NS_PER_S),
             Decision(Status.NOT_NEEDED, '', idles, 9000 * NS_PER_S),
             Decision(Status.INVALID_INPUT, 'No.')))
        expected = {
            'later_arrival': [Time(sec=5000 + 1200), Time(sec=9000 + 1200), Time()],
            'later_heating_start': [Time(sec=5000 + 777), Time(), Time()],
            'later_status': [Status.WAITING, Status.NOT_NEEDED, Status.INVALID_INPUT],
            'later_predicted_arrival_temperature': pytest.approx(
                [plan.arrival_temperature_c] * 2 + [nan], nan_ok=True),
            'later_predicted_arrival_soc': pytest.approx([plan.arrival_soc] * 2 + [nan], nan_ok=True)}
        assert set(expected) == {
            name for name in PreheatPlan.get_fields_and_field_types() if name.startswith('later_')}
        alone = plan_message(now, EAST, 99 * NS_PER_S)
        for name, values in expected.items():
            assert list(getattr(message, name)) == values, name
            assert len(getattr(alone, name)) == 0, name


# Texts of plans

def charger_route(**changed):
    """Return a RoutePlan of 30 min to a charger."""
    message = RoutePlan(**{
        'route_id': 'far', 'segment_duration': [60.0] * 30, 'speed': [25.0], 'propulsion_power': [15e3],
        'ambient_temperature': [-8.0], 'charging_planned': True, 'charger_power': 150e3,
        'charging_departure_soc': 0.75, **changed})
    message.header.stamp = Time(sec=START_S)
    return message


def planned(settings=Settings(estimation=False), **changed):
    """Return (Stepwise, PreheatPlan) at the start of a route without a stop."""
    supervisor = Stepwise(VEHICLE, settings)
    now_ns = START_S * NS_PER_S
    supervisor.run(now_ns)
    supervisor.accept_mission(mission_from_message(charger_route(**changed), VEHICLE.defaults, 30.0))
    supervisor.accept_battery(Measurement(STATE, now_ns), now_ns)
    return supervisor, plan_message(supervisor.state.decision, supervisor.state.mission, now_ns)


@pytest.mark.parametrize('changed, source', [
    ({}, PreheatPlan.TARGET_CHOSEN), ({'target_battery_temperature': 21.0}, PreheatPlan.TARGET_GIVEN),
    ({'charger_power': 0.0}, PreheatPlan.TARGET_DEFAULT),
    ({'charging_planned': False}, PreheatPlan.TARGET_UNKNOWN)])
def test_a_plan_says_where_its_target_comes_from(changed, source):
    supervisor, plan = planned(**changed)
    assert plan.target_source == source
    choice = supervisor.state.decision.target
    figures = (plan.charging_time, plan.charging_time_unheated, plan.bought_energy,
               plan.bought_energy_unheated)
    if source in (PreheatPlan.TARGET_CHOSEN, PreheatPlan.TARGET_GIVEN):
        assert figures == (choice.charging_time_s, choice.unheated_charging_time_s,
                           choice.bought_energy_wh, choice.unheated_bought_energy_wh)
        assert 0.0 < plan.charging_time < plan.charging_time_unheated
        minutes = round(plan.charging_time / 60.0)
        assert f'{minutes - 1}:' in charging_text(plan) or f'{minutes}:' in charging_text(plan)
    else:
        assert np.isnan(figures).all() and charging_text(plan) == ''
    assert bool(plan.target_reason) is (source != PreheatPlan.TARGET_UNKNOWN)


def test_a_message_that_nobody_filled_has_no_session():
    assert charging_text(PreheatPlan()) == ''
    endless = PreheatPlan(target_source=PreheatPlan.TARGET_CHOSEN, charging_time=60.0, bought_energy=500.0,
                          charging_time_unheated=inf, bought_energy_unheated=inf)
    assert charging_text(endless) == '1:00 min, 0.50 kWh; without heating never ends'
    endless.bought_energy = nan
    assert charging_text(endless) == ''


# Enums: the message files are the contract

@pytest.mark.parametrize('kind', [HvchCommand, PreheatPlan])
def test_constants_of_the_message_are_those_of_the_program(kind):
    text = (MESSAGES / f'{kind.__name__}.msg').read_text()
    constants = {name: int(value) for name, value in re.findall(r'^uint8 ([A-Z_]+)=(\d+)', text, re.MULTILINE)}
    others = {**{f'STRETCH_{reason.name}': reason.value for reason in Reason},
              **{f'TARGET_{source.name}': source.value for source in TargetSource}}
    assert constants == {**{status.name: status.value for status in Status},
                         **(others if kind is PreheatPlan else {})}
    # As built.
    assert {name: getattr(kind, name) for name in constants} == constants


def test_heating_that_does_not_pay_is_no_fault():
    supervisor, plan = planned(charger_power=50e3)
    assert plan.status == PreheatPlan.NOT_WORTH_IT and not plan.heating_planned
    entry = planner_diagnostics(supervisor.state, START_S * NS_PER_S)[0]
    assert entry.level == DiagnosticStatus.OK and entry.message.startswith('NOT_WORTH_IT: Not worth it')
    values = {pair.key: pair.value for pair in entry.values}
    assert values['target because'] == plan.target_reason


def test_powers_of_heat_sources_pass_to_the_page_or_not_at_all():
    car = load_vehicle('heat_pump_car')
    route = make_route({'duration_s': [60.0] * 20, 'speed_mps': [15.0], 'propulsion_power_w': [9e3],
                        'ambient_temperature_c': [-5.0]}, car.defaults)
    plan = plan_preheating(car, route, BatteryState(-10.0, 0.8), Goal(20.0))
    message = plan_message(Decision(plan.status, plan.explanation, plan, 50 * NS_PER_S), EAST, 99 * NS_PER_S)
    seen = plan_seen(message)
    assert list(seen.sources_w) == ['hvch', 'motor', 'heat_pump', 'chiller']
    assert {name: list(power_w) for name, power_w in seen.sources_w.items()} == {
        name: power_w.tolist() for name, power_w in plan.source_power_w.items()}
    message.heat_source_power = message.heat_source_power[1:]
    assert plan_seen(message).sources_w == {}
    # An instant of 0 is unknown.
    message.header.stamp.sec = message.header.stamp.nanosec = 0
    assert plan_seen(message).times_s == ()
