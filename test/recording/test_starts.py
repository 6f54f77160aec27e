# SPDX-License-Identifier: Apache-2.0
"""A replay begins at any second of a recording, and with any of its files, as equal as from the start."""

from dataclasses import replace
from functools import partial
import json
import random

import pytest

from bev_preheat.nodes import flight_recording
from bev_preheat.nodes.recorded_scenario import drive_recorded, MessageWire
from bev_preheat.numerics import NS_PER_S
from bev_preheat.recording.changes import Changes
from bev_preheat.recording.flight import read_flight, Start
from bev_preheat.recording.replay import replay, replay_changed
from bev_preheat.recording.ring import recordings_in
from bev_preheat.simulation.scenario import load_scenario

pytestmark = [pytest.mark.needs('mcap', 'rclpy'), pytest.mark.costly]


@pytest.fixture(scope='module')
def path(tmp_path_factory):
    """Return the recording of a drive that charges on the way, stands and drives on."""
    path = tmp_path_factory.mktemp('drive') / 'drive.mcap'
    drive_recorded(load_scenario('charges_early'), path, pytest.fail)
    return path


@pytest.fixture(scope='module')
def flight(path):
    return read_flight(path)


def test_from_any_second_on_it_is_reproduced_to_the_last_digit(flight):
    draw, length_s = random.Random(1), (flight.given[-1].step.now_ns - flight.start_ns) / NS_PER_S
    for _ in range(5):
        at_ns = flight.start_ns + round(draw.uniform(60.0, length_s) * NS_PER_S)
        rest = flight.from_instant(at_ns)
        assert len(rest.given) < len(flight.given)
        assert at_ns - 63 * NS_PER_S < rest.given[0].step.now_ns <= at_ns
        comparison = replay(rest).comparison
        assert comparison.is_reproduced and comparison.commands > 0


def test_steps_that_are_missing_are_made_up_for_by_the_next_state(flight):
    """Three minutes that the disk has lost: after the next recorded state all is equal again."""
    first, after = (next(index for index, given in enumerate(flight.given) if given.step.now_ns >= (
        flight.start_ns + at_s * NS_PER_S)) for at_s in (300, 480))
    lost = after - first
    starts = [start if start.at <= first else Start(start.at - lost, start.recorded, start.route)
              for start in flight.starts if not first < start.at <= after]
    damaged = replace(flight, given=(*flight.given[:first], *flight.given[after:]), gaps=(first,),
                      starts=tuple(starts))
    resumed = next(start.at for start in starts if start.at > first)
    comparison = replay(damaged).comparison
    if comparison.first is not None:
        assert first <= comparison.first.number < resumed
    # At most the minute until then differs: two commands a second.
    assert comparison.different <= 4 * 62
    rest = replace(damaged, given=damaged.given[resumed:], gaps=(), starts=tuple(
        Start(start.at - resumed, start.recorded, start.route) for start in starts if start.at >= resumed))
    assert replay(rest).comparison.is_reproduced


def test_a_change_from_the_middle_on_is_a_change_from_the_middle_on(flight):
    middle_ns = flight.given[len(flight.given) // 2].step.now_ns
    rest = flight.from_instant(middle_ns)
    as_it_was = replay_changed(rest, Changes(parameters={'value_of_time': 10.0}))
    cold = replay_changed(rest, Changes(parameters={'target_battery_temperature': -10.0}))
    assert as_it_was.instants[0].now_ns == cold.instants[0].now_ns >= middle_ns - 63 * NS_PER_S


def test_each_file_of_a_life_can_be_replayed_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(flight_recording, 'RecordingWriter', partial(
        flight_recording.RecordingWriter, largest_file_bytes=150_000))
    scenario = load_scenario('charges_early')
    from bev_preheat.simulation.scenario_drive import drive_scenario
    made = []

    def wire_to(supervisor):
        made.append(MessageWire(supervisor, scenario, str(tmp_path), pytest.fail))
        return made[-1]

    drive_scenario(scenario, wire=wire_to)
    made[0].close()
    files = recordings_in(tmp_path)
    assert len(files) > 3
    for number, file in enumerate(files):
        alone = tmp_path / f'alone_{number}'
        alone.mkdir()
        (alone / file.name).write_bytes(file.read_bytes())
        one = read_flight(alone / file.name)
        assert one.remarks == () and one.starts[0].at == 0
        assert replay(one).comparison.is_reproduced, number
    assert replay(read_flight(tmp_path)).comparison.is_reproduced


def test_the_command_begins_there(path, said):
    assert json.loads(said('replay', path, '--from', '700', '--json', '-')[1])['reproduced']
    assert said('replay', path, '--explain', '900')[0] == 0
