# SPDX-License-Identifier: Apache-2.0
"""The planner with departures: heating, skipping, a restart, a file that cannot be used."""

from datetime import datetime
from zoneinfo import ZoneInfo

from diagnostic_msgs.msg import DiagnosticStatus
from planner_car import heats, PlannerCar, values_of
import pytest
from std_srvs.srv import SetBool

from bev_preheat.numerics import NS_PER_S

ZONE = ZoneInfo('Europe/Berlin')
# A Thursday.
READY_NS = round(datetime(2026, 11, 26, 7, 30, tzinfo=ZONE).timestamp()) * NS_PER_S
WEEK = """
time_zone: Europe/Berlin
ambient_temperature_c: -5
departures:
  - {name: work, weekdays: [thursday, friday], time: '07:30', target_battery_temperature_c: 20, plugged_in: true}
"""
FIRST, SKIPPED_TO = 'work, Thu 2026-11-26 07:30 CET', 'work, Fri 2026-11-27 07:30 CET'


class Car(PlannerCar):
    """A planner, and a cold battery at the grid."""

    def __init__(self, bench, folder):
        super().__init__(bench)
        self.week, self.memory = folder / 'week.yaml', folder / 'state.json'
        self.week.write_text(WEEK)

    def start(self, *arguments):
        return super().start('-p', f'departures:={self.week}', '-p', f'state_file:={self.memory}', *arguments)

    def departure(self, condition=lambda values: True):
        """Return (entry, values) of the next entry on departures for which `condition(values)` holds."""
        self.diagnostics.clear()
        entry = self.entry('departures', lambda entry: condition(values_of(entry)))
        return entry, values_of(entry)

    def skip(self, skips=True):
        return self.bench.call(SetBool, 'planner/skip_departure', SetBool.Request(data=skips))

    def heats(self, is_heating=True):
        self.commands.clear()
        return self.commands.wait_for(lambda command: heats(command) is is_heating)


@pytest.fixture
def car(rehearsal, tmp_path):
    car = Car(rehearsal, tmp_path)
    with car.feeding(lambda: car.state(temperature=-5.0, percentage=0.7), 0.25):
        yield car


def test_a_departure_is_prepared_skipped_and_skipped_after_a_restart(car):
    car.at(READY_NS - 900 * NS_PER_S)
    first = car.start()
    assert car.heats()
    status, values = car.departure(lambda values: values['state'] == 'preparing')
    assert values['next departure'] == FIRST and status.level == DiagnosticStatus.OK
    assert values['next departure [s since 1970]'] == str(READY_NS // NS_PER_S)
    assert (values['target [degC]'], values['plugged in']) == ('20', 'true')
    # In quarter of an hour 25 K are too much for the heater; the plan says so and heats.
    assert car.plans.latest.route_id == '~/prepare_battery'
    response = car.skip()
    assert response.message == f'Skipped: {FIRST}; the next departure is {SKIPPED_TO}.'
    assert car.heats(is_heating=False)
    car.departure(lambda values: values['skipped'] == FIRST and values['next departure'] == SKIPPED_TO)
    first.kill()
    car.commands.clear()
    car.start()
    car.departure(lambda values: (values['skipped'], values['state']) == (FIRST, 'later'))
    assert not any(command.battery_heating_power for command in car.commands.wait_for_count(5))
    response = car.skip(False)
    assert response.success and f'The next departure is {FIRST}' in response.message
    assert car.heats()


def test_a_file_that_cannot_be_used_is_an_error_and_nothing_is_heated(car):
    car.week.write_text(WEEK.replace('07:30', '7h30'))
    car.start()
    status, values = car.departure()
    assert status.level == DiagnosticStatus.ERROR
    assert "departures[0].time: '7h30' is not allowed; it must be HH:MM" in status.message
    assert values['next departure'] == '' and values['state'] == 'none'
    assert car.heats(is_heating=False)
    response = car.skip()
    assert not response.success and 'no file that can be used' in response.message
