# SPDX-License-Identifier: Apache-2.0
"""A recording as tables for the page of `dashboard`."""

import json
import time

import pytest
from recorded_drive import LENGTH_S, START_NS

from bev_preheat.dashboard.plain import written
from bev_preheat.dashboard.recorded import lengths_of, RECORDED_PLAN_POINTS, RecordedSource, tables_of
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.replay.flight_file import read_flight

START_S = START_NS / NS_PER_S
LIMIT_S = 60.0


@pytest.fixture(scope='module')
def drive(recorded):
    """Return the drive's tables, as a browser reads them."""
    tables = json.loads(written(tables_of(read_flight(recorded[1]), lambda steps: None)),
                        parse_constant=lambda name: pytest.fail(name))
    (drive,) = tables['drives']
    return drive


def column(drive, key):
    index = drive['keys'].index(key)
    return [frame[index] for frame in drive['frames']]


def test_the_frames_have_what_the_planner_said(recorded, drive):
    commands = {now_ns: output.command for now_ns, output in recorded[0].outputs if output.command is not None}
    for at_s, power_w, reason in zip(*(column(drive, key) for key in ('at', 'power', 'reason'))):
        if power_w is not None:
            command = commands[round(at_s) * NS_PER_S]
            assert (power_w, reason) == (round(command.battery_heating_power_w, 1), command.reason.name)
    assert {'HEATING', 'ARRIVED'} <= set(column(drive, 'status'))
    assert any(power_w and power_w > 1000.0 for power_w in column(drive, 'power'))


def test_instants_rise_in_all_tables(drive):
    for times in (column(drive, 'at'), drive['history']['time'], drive['history']['powerTime'],
                  [plan['at'] for plan in drive['plans']], *(plan['planTime'] for plan in drive['plans'])):
        assert all(before < after for before, after in zip(times, times[1:]))
    assert column(drive, 'at')[-1] - START_S == pytest.approx(LENGTH_S, abs=10.0)


def test_each_plan_begins_at_its_instant_and_ends_on_arrival(drive):
    planned = [plan for plan in drive['plans'] if plan['planTime']]
    assert len(planned) > 20
    for plan in planned:
        assert abs(plan['planTime'][0] - plan['at']) <= 1.0 and len(plan['planTime']) <= RECORDED_PLAN_POINTS
        assert plan['planTime'][-1] == pytest.approx(START_S + LENGTH_S, abs=1.0)


def test_without_heating_it_would_be_colder_once_it_has_heated(drive):
    history = drive['history']
    # It is known from the first plan to the last one.
    gaps = [measured - unheated for measured, unheated in zip(history['measured'], history['unheated'])
            if unheated is not None]
    assert abs(gaps[0]) < 0.5 and gaps[-1] > 1.0 and len(gaps) > 0.9 * LENGTH_S


def test_it_has_the_result_in_words(drive):
    ((ended_s, arrival, energy),) = drive['results']
    assert ended_s - START_S == pytest.approx(LENGTH_S, abs=5.0)
    assert arrival.startswith('Arrived after 5:0') and energy.startswith('The heater was commanded ')
    assert drive['lapses'] == '' and drive['events']['lapses'] == []


def test_each_event_is_at_a_frame_with_its_status(drive):
    statuses = dict(zip(column(drive, 'at'), column(drive, 'status')))
    # Of several at one instant the last one counts.
    marked = {at_s: status for at_s, status, *_ in drive['events']['marks']}
    assert {at_s: statuses[at_s] for at_s in marked} == marked and len(marked) >= 3


def test_the_file_is_small(drive):
    # 5 min; diagnostics stand only where more than figures changed.
    assert len(written(drive)) < 500_000
    entries = column(drive, 'entries')
    assert entries[0] and entries.count(None) > 0.5 * len(entries)


def test_it_is_read_in_the_background(recorded):
    source = RecordedSource(str(recorded[1]))
    end_s, seen = time.monotonic() + LIMIT_S, set()
    while 'drives' not in (answer := json.loads(source.recording())):
        seen |= set(answer)
        assert time.monotonic() < end_s and seen <= {'progress'}
        time.sleep(0.01)
    assert source.mode == 'recording' and not source.has_controls and source.name.endswith('.mcap')


def test_what_is_no_recording_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match='has no recording'):
        RecordedSource(str(tmp_path))
    (tmp_path / 'x.mcap').write_bytes(b'nothing')
    with pytest.raises(InvalidInput, match='x.mcap'):
        RecordedSource(str(tmp_path / 'x.mcap'))


@pytest.mark.parametrize('seconds, lengths', [
    ([5, 6, 9], [4.0]), ([5, 6, 1, 2, 3], [1.0, 2.0]), ([5.0, 4.5, 6.0], [1.0]), ([7], [0.0]),
    # A simulated clock that starts.
    ([0, 0, 1_700_000_000, 1_700_000_005], [0.0, 5.0])])
def test_a_clock_that_is_set_begins_another_drive(seconds, lengths):
    assert lengths_of(round(second * NS_PER_S) for second in seconds) == lengths
