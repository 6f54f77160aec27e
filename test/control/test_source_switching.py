# SPDX-License-Identifier: Apache-2.0
"""Heat sources with steps of power, least times and a price of a start, counted from the commands of drives."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from bev_preheat.control.events import SourceStatusArrived
from bev_preheat.control.heater import HeaterStatus
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
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
STEPS_W = (1000.0, 2000.0, 2500.0)
TIMES = {'minimum_on_time_s': 300.0, 'minimum_off_time_s': 180.0}
PUMP = {'power_steps_w': STEPS_W, **TIMES}


def car_with(name='heat_pump', hvch_w=6500.0, **properties):
    return replace(CAR, hvch=replace(CAR.hvch, maximum_power_w=hvch_w), heat_sources=tuple(
        replace(source, **properties) if source.name == name else source for source in CAR.heat_sources))


def route_of(minutes=60, speeds_mps=(20.0,), air_c=-10.0):
    speed_mps = np.resize(np.array(speeds_mps), minutes)
    return make_route({
        'duration_s': [60.0] * minutes, 'speed_mps': speed_mps, 'propulsion_power_w': 600.0 * speed_mps,
        'ambient_temperature_c': [air_c] * minutes, 'cabin_heating_power_w': [1000.0 * (air_c < 20.0)] * minutes},
        CAR.defaults)


class Drive:
    """A drive, and the uses of a source in its commands: start, end [s], and the status at the end."""

    def __init__(self, car, name='heat_pump', start_c=-10.0, goal=Goal(25.0), route=None, until_s=np.inf,
                 heater_faults=(), **sensors):
        simulated = ImperfectCar(
            car, DrivePhase(route or route_of(), goal), BatteryState(start_c, 0.9),
            Imperfections(sensors=Sensors(period_s=4.0, **sensors), heater_faults=heater_faults))
        supervisor = Supervisor(car, Settings(command_period_s=2.0))
        self.plant, self.uses, self.powers_w, self.commands = simulated.plant, [], set(), []
        since_s = None
        for moment in moments(simulated, supervisor, lambda: (
                simulated.plant.is_standing or simulated.time_s >= until_s)):
            assert not moment.output.failure
            command = moment.output.command
            if command is None:
                continue
            power_w = command.power_w(name)
            self.commands.append((moment.time_s, command))
            self.powers_w.add(power_w)
            if power_w > 0.0 and since_s is None:
                since_s = moment.time_s
            elif power_w == 0.0 and since_s is not None:
                self.uses.append((since_s, moment.time_s, command.reason))
                since_s = None
        self.shares = {name: report.share for name, report in supervisor.state.source_reports.items()}

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


def test_a_doubt_switches_it_off_at_once_and_it_rests_then():
    drive = Drive(car_with(**PUMP), start_c=-20.0, until_s=800.0, drop_outs=((150.0, 165.0),))
    (since_s, end_s, reason), *_ = drive.uses
    assert reason is Status.STALE_INPUT and end_s - since_s < 200.0
    heating_s = next(at_s for at_s, command in drive.commands if at_s > end_s and command.total_w > 0.0)
    again_s = next(at_s for at_s, command in drive.commands if at_s > end_s and command.power_w('heat_pump') > 0.0)
    # The others serve while it rests.
    assert heating_s < end_s + 60.0 and again_s - end_s == pytest.approx(180.0, abs=4.0)


def test_a_pump_that_refuses_is_asked_on_and_serves_again():
    car = car_with(**PUMP)
    simulated = ImperfectCar(car, DrivePhase(route_of(), Goal(45.0)), BatteryState(-20.0, 0.9))
    supervisor = Supervisor(car, Settings())
    for moment in moments(simulated, supervisor, lambda: simulated.time_s >= 30.0):
        now_ns, power_w = supervisor.state.now_ns, supervisor.state.latest_command.power_w('heat_pump')
        is_refused = 10.0 < moment.time_s < 20.0
        output = supervisor.step(now_ns, SourceStatusArrived(HeaterStatus(
            now_ns, power_w, 0.0 if is_refused else power_w, Refusal(6 * is_refused)), 'heat_pump'))
        assert not output.failure and not moment.output.failure
        assert moment.time_s < 1.0 or power_w == 2500.0


def test_a_derated_source_is_commanded_in_its_own_steps():
    heater_faults = (HeaterFault(0.0, share=0.6, source='heat_pump'),)
    drive = Drive(car_with(hvch_w=2000.0, **PUMP), start_c=-18.0, until_s=1800.0, heater_faults=heater_faults)
    assert drive.shares['heat_pump'] == pytest.approx(0.6, abs=0.15)
    assert drive.powers_w <= {0.0, *STEPS_W}


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


def test_it_does_not_start_for_less_than_its_least_time():
    drive = Drive(car_with(minimum_on_time_s=3600.0), start_c=5.0, route=route_of(minutes=30))
    assert drive.powers_w == {0.0}
    assert drive.plant.temperature_c == pytest.approx(25.0, abs=0.3)


@pytest.mark.parametrize(('price_wh', 'is_used'), [(0.0, True), (20.0, True), (900.0, False)])
def test_a_start_that_saves_less_than_its_price_is_left_to_the_hvch(price_wh, is_used):
    drive = Drive(car_with(switch_on_wh=price_wh), start_c=18.0, route=route_of(minutes=20))
    assert (drive.plant.sources.energy_wh['heat_pump'] > 0.0) is is_used
    assert drive.plant.temperature_c == pytest.approx(25.0, abs=0.5)


def test_no_price_of_a_start_leaves_the_battery_cold():
    drive = Drive(car_with(hvch_w=0.0, switch_on_wh=900.0), start_c=15.0, route=route_of(minutes=30))
    assert drive.plant.temperature_c == pytest.approx(25.0, abs=0.5)


def test_a_chiller_has_steps_and_least_times_too():
    car = car_with('chiller', power_steps_w=(1500.0, 3000.0), **TIMES)
    goal = Goal(22.0, maximum_arrival_temperature_c=42.0)
    drive = Drive(car, 'chiller', 49.0, goal, route_of(25, (30.0,), 35.0))
    assert drive.powers_w <= {0.0, 1500.0, 3000.0} and drive.uses
    assert all(end_s - since_s >= 300.0 for since_s, end_s, reason in drive.uses if reason is not Status.ARRIVED)
    assert all(pause_s >= 180.0 for pause_s in drive.pauses_s)
    assert drive.plant.temperature_c == pytest.approx(42.0, abs=0.5)
