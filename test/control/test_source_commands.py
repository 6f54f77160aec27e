# SPDX-License-Identifier: Apache-2.0
"""
Heat sources beside the HVCH in the planner's step: one gate, one lease, one heat, and an answer of each.

Their steps of power, least times and the price of a start are counted from the commands of drives.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from simulated_drives import drive, with_source
from steady_drives import moment_of

from bev_preheat.control.decision import Unserved
from bev_preheat.control.events import SourceStatusArrived, SourceStatusUnreadable
from bev_preheat.control.heat_division import HeatDivision
from bev_preheat.control.heater import HeaterStatus
from bev_preheat.control.heater_switch import HeaterSwitch
from bev_preheat.control.learning import NO_TRIAL
from bev_preheat.control.settings import Settings
from bev_preheat.control.state_bytes import state_bytes, state_of
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.estimate import SOURCE_HEAT
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.simulation.heater import HeaterFault
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import UNKNOWN_UNCERTAINTY
from bev_preheat.vehicle.heater_controller import Refusal
from bev_preheat.vehicle.variants import with_heat

CAR = load_vehicle('heat_pump_car')
# It stands for the third of five minutes, in which the motor may not heat, and the cabin takes the HVCH.
ROUTE = make_route({
    'duration_s': [60.0] * 20, 'speed_mps': [15.0, 15.0, 0.0] + [15.0] * 17,
    'propulsion_power_w': [9e3, 9e3, 0.0] + [9e3] * 17, 'ambient_temperature_c': [-5.0] * 20,
    'cabin_heating_power_w': [500.0] * 3 + [6500.0] + [500.0] * 16, 'auxiliary_power_w': [400.0] * 20},
    CAR.defaults)


def driven(until_s=np.inf, goal=Goal(40.0), start_c=-10.0, car=CAR, route=ROUTE, **how):
    """Yield a Seen for each command of a drive to its end, or until an instant [s]."""
    return drive(car, DrivePhase(route, goal), BatteryState(start_c, 0.8), until_s, **how)


def state_after_the_start():
    *_, last = driven(2.0)
    return last.planner.state


@pytest.mark.parametrize('estimation', [True, False])
def test_all_heat_within_their_limits(estimation):
    commands = {seen.at_s // 60.0: seen.command for seen in driven(290.0, estimation=estimation)}
    for name, powers_w in {'motor': [3000.0, 3000.0, 0.0, 3000.0, 3000.0], 'heat_pump': [2500.0] * 5,
                           'hvch': [6000.0, 6000.0, 6000.0, 0.0, 6000.0]}.items():
        assert [command.power_w(name) for command in commands.values()] == pytest.approx(powers_w)
    assert all(command.total_w == pytest.approx(sum(map(command.power_w, ('hvch', 'motor', 'heat_pump'))))
               for command in commands.values())


@pytest.mark.parametrize('share', [0.8, 1.25])
@pytest.mark.parametrize('start_c, goal, most_w', [
    (-10.0, Goal(40.0), {'motor': 3000.0, 'heat_pump': 2500.0, 'hvch': 6000.0}),
    (54.0, Goal(5.0, maximum_arrival_temperature_c=10.0), {'chiller': 3000.0})])
def test_what_is_learned_about_sources_takes_no_power_from_a_target_out_of_reach(share, start_c, goal, most_w):
    described = replace(CAR, uncertainty=UNKNOWN_UNCERTAINTY)
    car = replace(CAR, heat_sources=tuple(with_heat(source, share) for source in CAR.heat_sources))
    *_, last = driven(900.0, goal, start_c, car, planned_for=described)
    assert last.decision.status is Status.TARGET_UNREACHABLE
    assert (np.exp(last.planner.state.estimate.mean[SOURCE_HEAT]) - 1.0) / (share - 1.0) > 0.1
    assert {name: last.command.power_w(name) for name in most_w} == pytest.approx(most_w)


def test_a_weak_chiller_that_runs_alone_is_not_switched_off_to_tell_it_from_others():
    car = replace(CAR, heat_sources=tuple(with_heat(source, 0.5) for source in CAR.heat_sources))
    described, goal = replace(CAR, uncertainty=UNKNOWN_UNCERTAINTY), Goal(5.0, maximum_arrival_temperature_c=10.0)
    commands = [seen.command for seen in driven(
        900.0, goal, 48.0, car, route_of(30, air_c=32.0), planned_for=described)]
    assert {round(command.power_w('chiller')) for command in commands[2:]} == {3000}


def test_what_is_commanded_is_what_is_learned_from():
    *_, last = driven(700.0)
    state, estimate = last.planner.state, last.planner.state.estimate
    assert estimate.temperature_c == pytest.approx(last.car.plant.temperature_c, abs=0.3)
    assert estimate.log_factors == pytest.approx(0.0, abs=0.06)
    assert estimate.heater.heater.value == 'answers'
    assert state_bytes(state_of(state_bytes(state))) == state_bytes(state)


def test_any_doubt_stops_all():
    *_, last = driven(70.0, sensors=Sensors(drop_outs=((50.0, 1e9),)))
    assert (last.command.reason, last.command.total_w, last.command.sources_w) == (Status.STALE_INPUT, 0.0, ())


def test_gates_of_the_car_stop_all():
    gated = replace(CAR, heating_gates=replace(CAR.heating_gates, minimum_soc=0.85))
    assert all(seen.command.total_w == 0.0 for seen in driven(60.0, car=gated))


def test_without_a_source_that_refuses_the_others_heat():
    heats, sentences = [], set()
    for seen in driven(700.0, Goal(0.0)):
        now_ns = seen.planner.state.now_ns
        sentences.add(seen.decision.explanation)
        if seen.at_s > 310.0 and seen.command.total_w > 0.0:
            heats.append(seen.command)
        if seen.at_s >= 300.0:
            fault = HeaterStatus(now_ns, 0.0, 0.0, Refusal.HEATER_FAULT, 'no refrigerant')
            assert not seen.planner.step(now_ns, SourceStatusArrived(fault, 'heat_pump')).refusals
    words = 'The heat_pump does not heat (HEATER_FAULT): no refrigerant.'
    assert any(words in sentence for sentence in sentences)
    # It is asked on, and draws nothing; the others reach the target.
    assert heats and all(command.power_w('heat_pump') > 0.0 for command in heats)
    assert all(command.power_w('motor') + command.power_w('hvch') > 0.0 for command in heats)


def test_a_source_that_reports_a_limit_is_planned_with_it():
    for seen in driven(90.0):
        now_ns, asked_w = seen.planner.state.now_ns, seen.command.power_w('heat_pump')
        half = HeaterStatus(now_ns, asked_w, 0.5 * asked_w, Refusal.HEATER_FAULT, 'low refrigerant')
        seen.planner.step(now_ns, SourceStatusArrived(half, 'heat_pump'))
    assert 'The heat_pump delivers only 50 % of its command.' in seen.decision.explanation
    # 2500 W, as the vehicle file says; the command stays.
    assert asked_w == pytest.approx(2500.0)
    assert max(seen.decision.plan.source_power_w['heat_pump']) == pytest.approx(1250.0)


def test_a_status_of_no_source_is_refused_and_named():
    supervisor = Supervisor(CAR, Settings())
    output = supervisor.step(10**18, SourceStatusUnreadable(InvalidInput('name: x'), 'heat_pump'))
    assert [refusal.source for refusal in output.refusals] == ['heat_source_status']
    assert supervisor.state.answers.others[1].problem == 'heat_source_status of heat_pump refused: name: x'


def test_a_dead_source_is_named_and_no_other():
    route = ROUTE.segments(19, 20).divided(60.0)
    for _ in range(5):
        route = route.followed_by(route)
    accused = set()
    # The heat pump heats alone until it fails.
    for seen in driven(1900.0, Goal(12.0), faults=[HeaterFault(60.0, share=0.0, source='heat_pump')], route=route):
        assert seen.at_s > 60.0 or seen.command.power_w('hvch') == 0.0
        accused = {name for name, report in seen.planner.state.learning.reports.items()
                   if report.heater is not Heater.ANSWERS}
        assert accused <= {'heat_pump'}
        if seen.decision.explanation.startswith('The heat_pump does not respond to its command. '):
            break
    assert accused == {'heat_pump'}
    assert seen.command.power_w('heat_pump') == 0.0 < seen.command.total_w


@pytest.mark.parametrize('odds, tried', [
    # Of a source that heats so little, a turn of a kelvin would never end.
    ({'hvch': 8.0, 'motor': 1.0, 'pump': 3.0, 'fan': 9.0},
     [''] * 30 + ['pump'] * 10 + ['motor'] * 20 + ['pump'] * 7),
    # Alone it heats for five minutes before its next turn; a source that is hardly weak is not switched off.
    ({'hvch': 4.0, 'motor': 0.2, 'pump': 0.3}, [''] * 30 + ['pump'] * 10 + [''] * 27),
    ({'hvch': 4.0, 'motor': 0.2, 'pump': 0.2}, [''] * 67)])
def test_sources_that_may_be_weak_are_tried_for_a_kelvin_of_their_heat_while_a_fault_has_no_name(odds, tried):
    trial, names = NO_TRIAL, []
    for at_s in range(0, 670, 10):
        heats_k_per_s = {**{'motor': 0.005, 'pump': 0.01, 'fan': 1e-9, 'chiller': 0.0}, trial.name: 0.0}
        trial = trial.at(at_s * 10**9, odds, False, heats_k_per_s)
        names.append(trial.name)
        assert trial.at(at_s * 10**9, odds, True, heats_k_per_s).name == ''
    assert names == tried


def moment_without(state, vehicle, *unserved):
    """Return the Moment of a State with another vehicle and other unserved heat sources, at -10 degC."""
    return moment_of(state, vehicle=vehicle, unserved=unserved, temperature_c=-10.0)


# In air of -5 degC a watt gives 2.25 W of heat by the pump, 0.75 W by the motor, 0.9 W by the HVCH: in the
# HVCH's watts the pump's 2500 W are 6250 W, and the motor's 3000 W are 2500 W; the cabin leaves the HVCH 6000 W.
@pytest.mark.parametrize('hvch_share, pump, limit_w, heat_w, hvch_w, pump_w', [
    (1.0, None, 14750.0, 8250.0, 2000.0, 2500.0),
    # A source that delivers a share of its command is commanded more, at most its limit.
    (0.5, None, 11750.0, 8250.0, 4000.0, 2500.0), (0.5, None, 11750.0, 9250.0, 6000.0, 2500.0),
    (1.0, (False, 0.6), 12250.0, 1500.0, 0.0, 1000.0), (1.0, (False, 0.6), 12250.0, 5750.0, 2000.0, 2500.0),
    # A silent HVCH and sources that refuse are asked on; dead ones are not.
    (0.0, None, 8750.0, 5000.0, 6000.0, 2000.0), (1.0, (True, 0.0), 8500.0, 2000.0, 2000.0, 2500.0),
    (1.0, (False, 0.0), 8500.0, 2000.0, 2000.0, 0.0)])
def test_the_others_make_up_for_what_a_source_lacks(hvch_share, pump, limit_w, heat_w, hvch_w, pump_w):
    state, unserved = state_after_the_start(), () if pump is None else (Unserved('heat_pump', '', *pump),)
    moment = moment_without(state, CAR, *unserved)
    division = HeatDivision(
        moment, replace(state.decision, command_share=hvch_share, vehicle=moment.heating_vehicle), ())
    assert division.limit_w == pytest.approx(limit_w)
    powers = division.divided(heat_w)
    assert (powers.hvch_w, dict(powers.sources_w).get('heat_pump', 0.0)) == pytest.approx((hvch_w, pump_w))


# Steps of power, least times and the price of a start

STEPS_W = (1000.0, 2000.0, 2500.0)
TIMES = {'minimum_on_time_s': 300.0, 'minimum_off_time_s': 180.0}
PUMP = {'power_steps_w': STEPS_W, **TIMES}


def car_with(name='heat_pump', hvch_w=6500.0, **properties):
    return with_source(replace(CAR, hvch=replace(CAR.hvch, maximum_power_w=hvch_w)), name, **properties)


def route_of(minutes=60, speeds_mps=(20.0,), air_c=-10.0):
    speed_mps = np.resize(np.array(speeds_mps), minutes)
    return make_route({
        'duration_s': [60.0] * minutes, 'speed_mps': speed_mps, 'propulsion_power_w': 600.0 * speed_mps,
        'ambient_temperature_c': [air_c] * minutes, 'cabin_heating_power_w': [1000.0 * (air_c < 20.0)] * minutes},
        CAR.defaults)


class Drive:
    """A drive, and the uses of a source in its commands: start, end [s], and the status at the end."""

    def __init__(self, car, name='heat_pump', start_c=-10.0, goal=Goal(25.0), route=None, until_s=np.inf,
                 faults=(), **sensors):
        self.uses, self.powers_w, self.commands = [], set(), []
        since_s = None
        for at_s, command, _, planner, simulated in driven(
                until_s, goal, start_c, car, route or route_of(), faults=faults,
                sensors=Sensors(period_s=4.0, **sensors), command_period_s=2.0):
            self.plant, reports, power_w = simulated.plant, planner.state.source_reports, command.power_w(name)
            self.commands.append((at_s, command))
            self.powers_w.add(power_w)
            if power_w > 0.0 and since_s is None:
                since_s = at_s
            elif power_w == 0.0 and since_s is not None:
                self.uses.append((since_s, at_s, command.reason))
                since_s = None
        self.shares = {name: report.share for name, report in reports.items()}

    @property
    def pauses_s(self):
        """The times between the uses [s]."""
        return [after[0] - before[1] for before, after in pairwise(self.uses)]


def test_a_heat_pump_with_steps_and_least_times_arrives_like_one_without():
    plain, real = Drive(CAR), Drive(car_with(**PUMP))
    assert real.plant.temperature_c == pytest.approx(plain.plant.temperature_c, abs=0.3)
    assert 1 <= len(real.uses) <= 3
    assert all(end_s - since_s >= 300.0 for since_s, end_s, _ in real.uses)
    assert all(pause_s >= 180.0 for pause_s in real.pauses_s)
    assert real.powers_w <= {0.0, *STEPS_W} and not plain.powers_w <= {0.0, *STEPS_W}
    assert real.plant.energy_wh.battery_total == pytest.approx(plain.plant.energy_wh.battery_total, rel=0.01)
    # It executes each command.
    assert real.plant.sources.energy_wh['heat_pump'] == pytest.approx(sum(
        command.power_w('heat_pump') * (after_s - at_s) for (at_s, command), (after_s, _) in pairwise(
            real.commands)) / 3600.0, rel=0.01)


def test_a_source_without_times_of_its_own_stays_on_for_that_of_the_planner():
    uses_s = [end_s - since_s for since_s, end_s, _ in Drive(
        car_with('motor', 4000.0), 'motor', -10.0, Goal(30.0), route_of(40)).uses]
    assert uses_s and min(uses_s) >= 20.0


def test_a_doubt_switches_it_off_at_once_and_it_rests_then():
    drive = Drive(car_with(**PUMP), start_c=-24.0, until_s=800.0, drop_outs=((150.0, 165.0),))
    (since_s, end_s, reason), *_ = drive.uses
    assert reason is Status.STALE_INPUT and end_s - since_s < 200.0
    heating_s = next(at_s for at_s, command in drive.commands if at_s > end_s and command.total_w > 0.0)
    again_s = next(at_s for at_s, command in drive.commands if at_s > end_s and command.power_w('heat_pump') > 0.0)
    # The others serve while it rests.
    assert heating_s < end_s + 60.0 and again_s - end_s == pytest.approx(180.0, abs=4.0)


def test_a_pump_that_refuses_is_asked_on_and_serves_again():
    for seen in drive(car_with(**PUMP), DrivePhase(route_of(), Goal(45.0)), BatteryState(-20.0, 0.9), 40.0):
        now_ns, power_w = seen.planner.state.now_ns, seen.command.power_w('heat_pump')
        is_refused = 10.0 < seen.at_s < 20.0
        assert not seen.planner.step(now_ns, SourceStatusArrived(HeaterStatus(
            now_ns, power_w, 0.0 if is_refused else power_w, Refusal(6 * is_refused)), 'heat_pump')).failure
        # Its least step while the others, which stood in for it, stay on for their least time.
        assert seen.at_s < 1.0 or power_w == 2500.0 or (20.0 <= seen.at_s <= 30.0 and power_w == 1000.0)


def test_a_derated_source_is_commanded_in_its_own_steps():
    faults = (HeaterFault(0.0, share=0.6, source='heat_pump'),)
    drive = Drive(car_with(hvch_w=2000.0, **PUMP), start_c=-18.0, until_s=1800.0, faults=faults)
    assert drive.shares['heat_pump'] == pytest.approx(0.6, abs=0.15)
    assert drive.powers_w <= {0.0, *STEPS_W}


@pytest.mark.parametrize('heat_w, pump_w', [(0.0, 1000.0), (1500.0, 1000.0), (3750.0, 2500.0)])
def test_a_derated_source_that_must_run_keeps_its_least_step(heat_w, pump_w):
    """Of the pump's 1000 W, 600 W become the heat of 1500 W of the HVCH."""
    state = state_after_the_start()
    running = HeaterSwitch().asked(state.now_ns, 2500.0, 2500.0, 300.0, 180.0)
    moment = moment_without(state, car_with(**PUMP), Unserved('heat_pump', '', False, 0.6))
    division = HeatDivision(
        moment, replace(state.decision, vehicle=moment.heating_vehicle), (('heat_pump', running),))
    assert division.held_w == pytest.approx(1500.0)
    assert division.divided(heat_w)[:2] == (0.0, (('heat_pump', pump_w),))


def test_the_hvch_has_steps_beside_other_sources():
    gates = replace(CAR.heating_gates, power_steps_w=(1500.0, 3000.0))
    drive = Drive(replace(car_with(**PUMP), heating_gates=gates), 'hvch', -20.0, Goal(30.0), route_of(40))
    assert {0.0, 3000.0} <= drive.powers_w <= {0.0, 1500.0, 3000.0}
    assert drive.plant.temperature_c == pytest.approx(30.0, abs=0.5)


def test_short_stops_give_a_source_that_needs_motion_its_rest():
    car = car_with('motor', 1500.0, power_steps_w=(1500.0, 3000.0), minimum_off_time_s=180.0)
    stops = route_of(minutes=40, speeds_mps=(20.0,) * 4 + (0.0,))
    drive = Drive(car, 'motor', -20.0, Goal(50.0), stops)
    assert len(drive.uses) > 3 and drive.plant.sources.energy_wh['motor'] > 300.0
    assert drive.pauses_s == pytest.approx([180.0] * len(drive.pauses_s), abs=4.0)


def test_the_hvch_keeps_its_least_times_beside_a_heat_pump():
    """The parameters of the node say so: 20 s on, 120 s off; the noise of a reading asks for more or less heat."""
    drive = Drive(CAR, 'hvch', goal=Goal(30.0), route=route_of(40), temperature_noise_k=0.1)
    assert drive.uses and all(end_s - since_s >= 20.0 for since_s, end_s, _ in drive.uses)
    assert all(pause_s >= 120.0 for pause_s in drive.pauses_s)
    assert drive.plant.temperature_c == pytest.approx(30.0, abs=0.8)


@pytest.mark.parametrize('properties, start_c, minutes, is_used', [
    ({'switch_on_wh': 0.0}, 18.0, 20, True), ({'switch_on_wh': 20.0}, 18.0, 20, True),
    ({'switch_on_wh': 900.0}, 18.0, 20, False), ({'minimum_on_time_s': 3600.0}, 5.0, 30, False),
    # No price leaves the battery cold.
    ({'switch_on_wh': 900.0, 'hvch_w': 0.0}, 15.0, 30, True)])
def test_a_source_starts_for_its_least_time_if_that_saves_its_price_or_nothing_else_heats(
        properties, start_c, minutes, is_used):
    drive = Drive(car_with(**properties), start_c=start_c, route=route_of(minutes))
    assert (drive.plant.sources.energy_wh['heat_pump'] > 0.0) is is_used
    assert drive.plant.temperature_c == pytest.approx(25.0, abs=0.5)


def test_a_chiller_has_steps_and_least_times_too():
    car = car_with('chiller', power_steps_w=(1500.0, 3000.0), **TIMES)
    goal = Goal(22.0, maximum_arrival_temperature_c=42.0)
    drive = Drive(car, 'chiller', 49.0, goal, route_of(25, (30.0,), 35.0))
    assert drive.powers_w <= {0.0, 1500.0, 3000.0} and drive.uses
    assert all(end_s - since_s >= 300.0 for since_s, end_s, reason in drive.uses if reason is not Status.ARRIVED)
    assert all(pause_s >= 180.0 for pause_s in drive.pauses_s)
    assert drive.plant.temperature_c == pytest.approx(42.0, abs=0.5)
