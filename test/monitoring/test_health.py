# SPDX-License-Identifier: Apache-2.0
"""The banner: a missing, silent or frozen planner."""

import pytest

from bev_preheat.messages.diagnostics import diagnostics, entry, ERROR, OK, WARN
from bev_preheat.monitoring.seen import diagnose, entries_seen, MOST_ENTRIES
from bev_preheat.monitoring.view import banner_of, Pulse, Surroundings

THERE = Surroundings()


def beating(until_s, stamp_s=None):
    """Return the Pulse of messages every second until `until_s`; a fixed stamp or a running one."""
    pulse = Pulse()
    for second in range(until_s + 1):
        pulse.beat(float(second), float(second) if stamp_s is None else stamp_s)
    return pulse


@pytest.mark.parametrize('around, command, battery, now_s, told', [
    (THERE, beating(60), beating(60), 65.0, 'error: The planner is silent: no message for 5 s'),
    (Surroundings(is_simulated=True, has_clock=True), beating(60), beating(60), 65.0,
     'error: The clock stands: /clock does not advance'),
    (Surroundings(is_simulated=True), beating(60), beating(60), 65.0,
     'error: The clock stands: nothing publishes /clock'),
    (Surroundings(rivals='/preheat_plan has 2 publishers, /a, /b; it must have one'), beating(60), beating(60),
     65.0, 'error: /preheat_plan has 2 publishers, /a, /b; it must have one. Their plans are not mixed'),
    (Surroundings(is_there=False), beating(60), beating(60), 65.0, 'error: The planner has disappeared'),
    # It still answers.
    (THERE, beating(60, stamp_s=5.0), beating(60), 60.5, "error: The planner's clock has been standing for 60 s"),
    (THERE, beating(60), beating(50), 60.4, 'warning: No battery state for 10 s'),
    (THERE, beating(60), beating(60, stamp_s=7.0), 60.4, 'warning: The battery state repeats one stamp')])
def test_silence_standing_clocks_and_old_battery_states_are_told(around, command, battery, now_s, told):
    banner = banner_of(around, command, battery, now_s)
    assert f'{banner.level}: {banner.text}'.startswith(told)


def diagnosed(*entries, others=0):
    """Return the Diagnosis of a planner's entries; `others` entries at the end belong to another node."""
    own, foreign = (diagnostics(node, '', 0, part) for node, part in (
        ('/car/planner', entries[:len(entries) - others]), ('/planner', entries[len(entries) - others:])))
    own.status = [*own.status, *foreign.status]
    return diagnose(entries_seen(own, '/car/planner'))


def test_entries_are_read():
    found = diagnosed(
        entry('preheating', OK, 'WAITING', {'enabled': 'false', 'goal of prepare_battery': 'ready in 5 min'}),
        entry('signals', WARN, '', {'regime': 'charging', 'current in doubt since [s]': '12'}),
        entry('departures', OK, '', {'next departure': 'Mon 07:30', 'state': 'WAITS', 'skipped': ''}),
        entry('preheating', ERROR, 'of another'), others=1)
    assert (found.is_enabled, found.goal, found.regime, found.doubts) == (
        False, 'ready in 5 min', 'charging', ('current',))
    assert found.departure == {'next_words': 'Mon 07:30', 'state': 'WAITS', 'skipped': ''}


def test_a_flood_of_entries_is_cut():
    found = diagnosed(*(entry(f'{number}', bytes([9]), 'x' * 10_000) for number in range(1000)))
    shown = found.as_dictionary()['entries']
    assert len(shown) == MOST_ENTRIES and {level for _, level, _ in shown} == {'STALE'}
    assert max(len(text) for _, _, text in shown) < 700
