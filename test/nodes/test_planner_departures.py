# SPDX-License-Identifier: Apache-2.0
"""The installed planner with departures, in simulated time over DDS: heating, skipping, restart, files."""

from datetime import datetime
import os
import signal
import subprocess
import sys
from zoneinfo import ZoneInfo

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from node_bench import poll_until, repeating
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState
from std_srvs.srv import SetBool

from bev_preheat.console.program import FAILED
from bev_preheat.control.inputs import NS_PER_S
from bev_preheat.nodes.convert import time_message
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan

ZONE = ZoneInfo('Europe/Berlin')
# A Thursday.
READY_NS = round(datetime(2026, 11, 26, 7, 30, tzinfo=ZONE).timestamp()) * NS_PER_S
WEEK = """
time_zone: Europe/Berlin
ambient_temperature_c: -5
departures:
  - {name: work, weekdays: [thursday, friday], time: '07:30', target_battery_temperature_c: 20, plugged_in: true}
"""
# One hour before the departure costs a tenth of the next.
PRICES = """
time_zone: Europe/Berlin
daily:
  - {from: '05:30', price_per_kwh: 0.03}
  - {from: '06:30', price_per_kwh: 0.30}
"""
PREPARE = [sys.executable, '-m', 'bev_preheat', 'prepare']
LIMIT_S = 240.0
FIRST, SKIPPED_TO = 'work, Thu 2026-11-26 07:30 CET', 'work, Fri 2026-11-27 07:30 CET'


class Car:
    """A planner in simulated time that stands still unless it is set, and a cold battery at the grid."""

    def __init__(self, bench, folder):
        self.bench, self.now_ns = bench, READY_NS - 3600 * NS_PER_S
        self.commands = bench.record(HvchCommand, 'hvch_command')
        self.plans = bench.record(PreheatPlan, 'preheat_plan')
        self.diagnostics = bench.record(DiagnosticArray, '/diagnostics')
        self._clock = bench.publisher(Clock, '/clock')
        self._states = bench.publisher(BatteryState, 'battery_state')
        self.week, self.prices, self.memory = (
            folder / name for name in ('week.yaml', 'prices.yaml', 'state.json'))
        self.week.write_text(WEEK)
        self.prices.write_text(PRICES)

    def start(self, *arguments):
        return self.bench.start(
            'planner', '-p', 'use_sim_time:=true', '-p', f'departures:={self.week}',
            '-p', f'state_file:={self.memory}', *arguments)

    def tick(self):
        # Simulated time runs a little, or the timers of the planner would never fire.
        self.now_ns += NS_PER_S // 4
        self._clock.publish(Clock(clock=time_message(self.now_ns)))
        state = BatteryState(temperature=-5.0, percentage=0.7)
        state.header.stamp = time_message(self.now_ns)
        self._states.publish(state)

    def entry(self, condition=lambda values: True):
        """Return (entry, values) of the latest entry on departures once `condition(values)` holds."""
        def found():
            for message in self.diagnostics.messages[-5:]:
                for status in message.status:
                    values = {item.key: item.value for item in status.values}
                    if status.name == 'planner: departures' and condition(values):
                        return status, values
            return None

        self.diagnostics.clear()
        return poll_until(found, 'an entry on departures', LIMIT_S)

    def heats(self, is_heating=True):
        self.commands.clear()
        return self.commands.wait_for(lambda command: (command.battery_heating_power > 0.0) is is_heating)


@pytest.fixture
def car(bench, tmp_path):
    car = Car(bench, tmp_path)
    with repeating(car.tick, 0.05):
        yield car


def test_a_departure_is_prepared_skipped_and_skipped_after_a_restart(car, domain_id):
    car.now_ns = READY_NS - 900 * NS_PER_S
    first = car.start()
    assert car.heats()
    status, values = car.entry(lambda values: values['state'] == 'preparing')
    assert values['next departure'] == FIRST and status.level == DiagnosticStatus.OK
    assert values['next departure [s since 1970]'] == str(READY_NS // NS_PER_S)
    assert (values['target [degC]'], values['plugged in']) == ('20', 'true')
    car.plans.wait_for(lambda plan: plan.route_id == '~/prepare_battery')
    # In quarter of an hour 25 K are too much for the heater; the plan says so and heats.
    skipped = subprocess.run(
        [*PREPARE, '--skip-next'], text=True, capture_output=True, timeout=LIMIT_S,
        env={**os.environ, 'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'})
    assert (skipped.returncode, skipped.stderr) == (0, '')
    assert skipped.stdout == f'Skipped: {FIRST}; the next departure is {SKIPPED_TO}.\n'
    assert car.heats(is_heating=False)
    car.entry(lambda values: values['skipped'] == FIRST and values['next departure'] == SKIPPED_TO)
    first.send_signal(signal.SIGKILL)
    first.wait()
    car.commands.clear()
    second = car.start()
    car.entry(lambda values: (values['skipped'], values['state']) == (FIRST, 'later'))
    assert not any(command.battery_heating_power for command in car.commands.wait_for_count(5))
    response = car.bench.call(SetBool, 'planner/skip_departure', SetBool.Request(data=False))
    assert response.success and f'The next departure is {FIRST}' in response.message
    assert car.heats()
    assert 'Traceback' not in first.output() + second.output()


def test_with_prices_it_heats_in_the_cheap_hour_until_it_is_skipped(car):
    # 05:30 ... 06:30 is cheap; at 06:00 there is time left.
    car.now_ns = READY_NS - 5400 * NS_PER_S
    process = car.start('-p', f'grid_prices:={car.prices}')
    assert car.heats()
    car.plans.wait_for(lambda plan: 'in the cheapest hours' in plan.explanation, 'the sentence')
    response = car.bench.call(SetBool, 'planner/skip_departure', SetBool.Request(data=True))
    assert response.success and car.heats(is_heating=False)
    assert 'Traceback' not in process.output()


def test_a_file_that_cannot_be_used_is_an_error_and_nothing_is_heated(car):
    car.week.write_text(WEEK.replace('07:30', '7h30'))
    process = car.start()
    status, values = car.entry()
    assert status.level == DiagnosticStatus.ERROR
    assert "departures[0].time: '7h30' is not allowed; it must be HH:MM" in status.message
    assert values['next departure'] == '' and values['state'] == 'none'
    assert car.heats(is_heating=False)
    response = car.bench.call(SetBool, 'planner/skip_departure', SetBool.Request(data=True))
    assert not response.success and 'no file that can be used' in response.message
    assert 'Traceback' not in process.output()


def test_without_departures_there_is_nothing_to_skip(car, domain_id):
    car.week.write_text(WEEK.split('departures:', maxsplit=1)[0] + 'departures: []\n')
    car.start()
    car.entry()
    skipped = subprocess.run([*PREPARE, '--skip-next'], text=True, capture_output=True, timeout=LIMIT_S,
                             env={**os.environ, 'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'})
    assert (skipped.returncode, skipped.stdout) == (FAILED, 'There is no departure to skip.\n')
