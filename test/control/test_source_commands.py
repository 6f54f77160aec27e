# SPDX-License-Identifier: Apache-2.0
"""Heat sources beside the HVCH in the planner's step: one gate, one lease, one heat, and an answer of each."""

from collections import deque
from dataclasses import replace

import pytest

from bev_preheat.control.events import SourceStatusArrived, SourceStatusUnreadable
from bev_preheat.control.heater import HeaterStatus
from bev_preheat.control.learning import NO_TRIAL
from bev_preheat.control.settings import Settings
from bev_preheat.control.state_bytes import state_bytes, state_of
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.simulation.heater import HeaterFault
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.simulation.supervised_drive import moments
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.heater_controller import Refusal

CAR = load_vehicle('heat_pump_car')
# It stands for the third of five minutes, in which the motor may not heat, and the cabin takes the HVCH.
ROUTE = make_route({
    'duration_s': [60.0] * 20, 'speed_mps': [15.0, 15.0, 0.0] + [15.0] * 17,
    'propulsion_power_w': [9e3, 9e3, 0.0] + [9e3] * 17, 'ambient_temperature_c': [-5.0] * 20,
    'cabin_heating_power_w': [500.0] * 3 + [6500.0] + [500.0] * 16, 'auxiliary_power_w': [400.0] * 20},
    CAR.defaults)


def driven(until_s, target_c=40.0, faults=(), sensors=Sensors(), car=CAR, route=ROUTE, **settings):
    """Yield (instant [s], command, Supervisor, ImperfectCar) of a drive."""
    simulated = ImperfectCar(car, DrivePhase(route, Goal(target_c)), BatteryState(-10.0, 0.8),
                             Imperfections(sensors=sensors, heater_faults=tuple(faults)))
    supervisor = Supervisor(car, Settings(**settings))
    for moment in moments(simulated, supervisor, lambda: simulated.time_s >= until_s):
        assert not moment.output.failure
        if moment.output.command is not None:
            yield moment.time_s, moment.output.command, supervisor, simulated


@pytest.mark.parametrize('estimation', [True, False])
def test_all_heat_within_their_limits(estimation):
    commands = {int(time_s // 60): command for time_s, command, _, _ in driven(290.0, estimation=estimation)}
    for name, powers_w in {'motor': [3000.0, 3000.0, 0.0, 3000.0, 3000.0], 'heat_pump': [2500.0] * 5,
                           'hvch': [6000.0, 6000.0, 6000.0, 0.0, 6000.0]}.items():
        assert [command.power_w(name) for command in commands.values()] == pytest.approx(powers_w)
    assert all(command.total_w == pytest.approx(sum(map(command.power_w, ('hvch', 'motor', 'heat_pump'))))
               for command in commands.values())


def test_what_is_commanded_is_what_is_learned_from():
    _, _, supervisor, car = deque(driven(700.0), maxlen=1)[0]
    estimate = supervisor.state.estimate
    assert estimate.temperature_c == pytest.approx(car.plant.temperature_c, abs=0.3)
    assert estimate.log_factors == pytest.approx(0.0, abs=0.06)
    assert estimate.heater.heater.value == 'answers'
    state = supervisor.state
    assert state_bytes(state_of(state_bytes(state))) == state_bytes(state)


def test_any_doubt_stops_all():
    last = [command for _, command, _, _ in driven(70.0, sensors=Sensors(drop_outs=((50.0, 1e9),)))][-1]
    assert (last.reason, last.total_w, last.sources_w) == (Status.STALE_INPUT, 0.0, ())


def test_gates_of_the_car_stop_all():
    gated = replace(CAR, heating_gates=replace(CAR.heating_gates, minimum_soc=0.85))
    assert all(command.total_w == 0.0 for _, command, _, _ in driven(60.0, car=gated))


def test_without_a_source_that_refuses_the_others_heat():
    supervisor = Supervisor(CAR, Settings())
    simulated = ImperfectCar(CAR, DrivePhase(ROUTE, Goal(0.0)), BatteryState(-10.0, 0.8))
    seen = {}
    for moment in moments(simulated, supervisor, lambda: simulated.time_s >= 700.0):
        command, now_ns = moment.output.command, supervisor.state.now_ns
        if command is None:
            continue
        seen[int(moment.time_s)] = command, supervisor.state.decision.explanation
        if moment.time_s >= 300.0:
            fault = HeaterStatus(now_ns, 0.0, 0.0, Refusal.HEATER_FAULT, 'no refrigerant')
            output = supervisor.step(now_ns, SourceStatusArrived(fault, 'heat_pump'))
            assert not output.refusals
    heats = [command for time_s, (command, _) in seen.items() if time_s > 310 and command.total_w > 0.0]
    words = 'The heat_pump does not heat (HEATER_FAULT): no refrigerant.'
    assert any(words in sentence for _, sentence in seen.values())
    # It is asked on, and draws nothing; the others reach the target.
    assert heats and all(command.power_w('heat_pump') > 0.0 for command in heats)
    assert all(command.power_w('motor') + command.power_w('hvch') > 0.0 for command in heats)


def test_a_status_of_no_source_is_refused_and_named():
    supervisor = Supervisor(CAR, Settings())
    output = supervisor.step(10**18, SourceStatusUnreadable(InvalidInput('name: x'), 'heat_pump'))
    assert [refusal.source for refusal in output.refusals] == ['heat_source_status']
    assert supervisor.state.answers.others[1].problem == 'heat_source_status of heat_pump refused: name: x'


@pytest.mark.parametrize('faults', [(), (HeaterFault(100.0, share=0.0, source='motor'),)])
def test_a_fault_of_a_source_is_its_own(faults):
    _, _, _, car = deque(driven(300.0, faults=faults), maxlen=1)[0]
    energy_wh = car.plant.sources.energy_wh
    assert (energy_wh['motor'] < 90.0) is bool(faults)
    assert energy_wh['heat_pump'] == pytest.approx(2500.0 * 299.0 / 3600.0, rel=0.02)


def test_a_dead_source_is_named_and_no_other():
    route = ROUTE.segments(19, 20).divided(60.0)
    for _ in range(5):
        route = route.followed_by(route)
    accused = set()
    # The heat pump heats alone until it fails.
    for at_s, command, supervisor, _ in driven(
            1900.0, target_c=12.0, faults=[HeaterFault(60.0, share=0.0, source='heat_pump')], route=route):
        assert at_s > 60.0 or command.power_w('hvch') == 0.0
        accused = {name for name, report in supervisor.state.learning.reports.items()
                   if report.heater is not Heater.ANSWERS}
        assert accused <= {'heat_pump'}
        if supervisor.state.decision.explanation.startswith('The heat_pump does not respond to its command. '):
            break
    assert accused == {'heat_pump'}
    assert command.power_w('heat_pump') == 0.0 < command.total_w


@pytest.mark.parametrize('odds, tried', [
    ({'hvch': 1e3, 'motor': 1e2, 'pump': 1e3}, ['', 'pump', 'motor', 'pump']),
    ({'hvch': 1.0, 'motor': 1.0, 'pump': 1e2}, [''] * 4)])
def test_sources_are_tried_in_turn_while_a_fault_has_no_name(odds, tried):
    trial, names = NO_TRIAL, []
    for at_s in range(0, 661, 10):
        trial = trial.at(at_s * 10**9, odds, is_told=False)
        if at_s in (290, 300, 420, 540):
            names.append(trial.name)
    assert names == tried
    assert trial.at(700 * 10**9, odds, is_told=True).name == ''
