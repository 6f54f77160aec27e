# SPDX-License-Identifier: Apache-2.0
"""The planner's State: a step leaves the one before as it was, and written and read back it goes on the same."""

from datetime import time, UTC
import json
import random
import zlib
from zoneinfo import ZoneInfo

import pytest

from bev_preheat.control.departures import DailyPrice, GridPrices, PricePeriod
from bev_preheat.control.events import BatteryStateArrived, PreparationWanted
from bev_preheat.control.inputs import Measurement
from bev_preheat.control.preparation_goal import PreparationGoal
from bev_preheat.control.settings import Settings, settings_of
from bev_preheat.control.state import State
from bev_preheat.control.state_bytes import state_bytes, state_of
from bev_preheat.control.supervisor import step, Supervisor
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.situation import BatteryState
from bev_preheat.simulation.scenario import load_scenario
from bev_preheat.simulation.supervised_drive import moments
from bev_preheat.vehicle import load_vehicle

# Charging on the way with a target that is chosen, a trip that ends and another one, a heater that is too weak, a
# clock that is set back, and two batteries on one topic.
DRIVES = ['charges_early_and_heats', 'two_batteries', *(pytest.param(name, marks=pytest.mark.deep) for name in (
    'cold_second_trip', 'heater_derated', 'clock_back'))]


class Forgetful(Supervisor):
    """A Supervisor that is written and read back before drawn steps; it notes all outputs as text."""

    def __init__(self, *arguments, share=0.0, seed=0):
        super().__init__(*arguments)
        self.share, self.random, self.said = share, random.Random(seed), []

    def step(self, now_ns, *events):
        if self.random.random() < self.share:
            self.go_on_from(state_of(state_bytes(self.state)))
        output = super().step(now_ns, *events)
        decision, state, timetable = output.decision, self.state, self.state.inbox.timetable
        self.said.append((
            now_ns, repr(output.command), output.refusals, output.failure, output.has_new_status,
            None if decision is None else (decision.status, decision.explanation, decision.arrival_deviation_k),
            state.regime, state.signal_verdicts,
            timetable and (timetable.latest, timetable.delay_ns, timetable.stood_ns, timetable.end),
            state.inbox.choices, state.last_seen,
            None if state.estimate is None else state.estimate.mean.tolist()))
        return output


def said_on(name, until_s, **options):
    scenario = load_scenario(name)
    planner, car = Forgetful(scenario.vehicle, settings_of(scenario.planner), **options), scenario.car()
    for _ in moments(car, planner, lambda: car.is_over or car.time_s >= until_s):
        pass
    return [str(said) for said in planner.said]


@pytest.mark.costly
@pytest.mark.parametrize('name', DRIVES)
def test_written_and_read_back_at_drawn_instants_it_says_the_same_to_the_last_digit(name):
    until_s = 900.0 if name in ('heater_derated', 'two_batteries') else 1500.0
    assert said_on(name, until_s, share=0.02, seed=name) == said_on(name, until_s)


@pytest.mark.costly
@pytest.mark.parametrize('name', DRIVES)
def test_a_step_changes_nothing_in_the_state_before_it(name):
    scenario = load_scenario(name)
    draw, compared = random.Random(name), 0

    class Watched(Supervisor):
        def step(self, now_ns, *events):
            nonlocal compared
            before = self.state
            if draw.random() > 0.03:
                return super().step(now_ns, *events)
            written = state_bytes(before)
            output = super().step(now_ns, *events)
            assert state_bytes(before) == written
            # The same step from the same state has the same result, but for the time that planning took.
            _, again = step(before, now_ns, *events)
            assert repr(again.command) == repr(output.command)
            if output.decision is not None:
                assert again.decision.explanation == output.decision.explanation
            compared += 1
            return output

    planner, car = Watched(scenario.vehicle, settings_of(scenario.planner)), scenario.car()
    for _ in moments(car, planner, lambda: car.is_over or car.time_s >= 900.0):
        pass
    assert compared > 20


@pytest.fixture(scope='module')
def written():
    return state_bytes(State.begun(load_vehicle('reference'), Settings()))


def edited(written, edit):
    head, _, body = written.partition(b'\n')
    values = json.loads(zlib.decompress(body))
    edit(values)
    return head + b'\n' + zlib.compress(json.dumps(values).encode())


@pytest.mark.parametrize('contents', [b'', b'{}', b'\x00' * 100])
def test_other_files_are_refused(contents):
    with pytest.raises(InvalidInput, match='no state of the planner'):
        state_of(contents)


def test_every_flipped_byte_is_refused_or_read_as_a_state(written):
    draw = random.Random(3)
    for _ in range(200):
        at = draw.randrange(len(written))
        try:
            state_of(written[:at] + bytes([written[at] ^ 1 << draw.randrange(8)]) + written[at + 1:])
        except InvalidInput:
            continue


def test_another_format_is_refused_by_name(written):
    with pytest.raises(InvalidInput, match=r"format '7' of version '9\.9\.9'; this version reads format 1"):
        state_of(b'bev_preheat state 7 9.9.9\n' + written.partition(b'\n')[2])


def test_a_state_with_other_fields_names_the_class_and_the_versions(written):
    def drop(values):
        kind = next(kind for kind in values['classes'] if kind[1] == 'HeaterSwitch')
        kind[2] = kind[2][1:]

    with pytest.raises(InvalidInput, match='of version .*, and its .HeaterSwitch. has other fields'):
        state_of(edited(written, drop))


@pytest.mark.parametrize('module, name', [
    ('subprocess', 'Popen'), ('bev_preheat.nodes.planner_node', 'PlannerNode'), ('os', 'system'),
    ('bev_preheat.control.state_bytes', 'state_of'), ('bev_preheat.control.inbox', 'electrical_check')])
def test_only_classes_of_values_are_made(written, module, name):
    def put(values):
        values['classes'].append([module, name, []])

    with pytest.raises(InvalidInput):
        state_of(edited(written, put))


def test_what_is_no_value_cannot_be_written():
    with pytest.raises(TypeError, match='is no value'):
        state_bytes(['a', 1])


@pytest.mark.parametrize('zone', [UTC, ZoneInfo('Europe/Berlin')], ids=str)
def test_a_preparation_in_the_cheapest_hours_goes_on_the_same(zone):
    """Prices have a time zone and times of day."""
    start_ns, minute_ns = 1_768_197_600 * 10 ** 9, 60 * 10 ** 9
    ready_ns = start_ns + 180 * minute_ns
    prices = GridPrices(zone, (DailyPrice(time(0), 0.4), DailyPrice(time(7, 30), 0.2)),
                        (PricePeriod(start_ns + 30 * minute_ns, start_ns + 50 * minute_ns, 0.1),))
    planner, restored = (Supervisor(load_vehicle('reference'), Settings()) for _ in range(2))
    said = []
    for minute in range(180):
        now_ns = start_ns + minute * minute_ns
        events = [BatteryStateArrived(Measurement(BatteryState(-10.0, 0.6), now_ns))]
        if minute == 1:
            events.append(PreparationWanted(PreparationGoal(ready_ns, 10.0, True, -10.0, prices=prices)))
        said.append([step.decision.explanation for step in (
            planner.step(now_ns, *events), restored.step(now_ns, *events))])
        restored.go_on_from(state_of(state_bytes(planner.state)))
    assert [first for first, _ in said] == [second for _, second in said]
    assert any('in the cheapest hours' in first for first, _ in said)
