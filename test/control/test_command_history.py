# SPDX-License-Identifier: Apache-2.0
"""The heater's latest commands, compared with sums over every millisecond."""

from hypothesis import given
from hypothesis import strategies as st
import pytest

from bev_preheat.control.command_history import CommandHistory, KEPT_NS

MS = 1_000_000
COMMANDS = st.lists(st.tuples(st.integers(1, 400), st.sampled_from([0.0, 900.0, 5300.0, 7000.0])),
                    max_size=12)


@pytest.mark.costly
@given(commands=COMMANDS, start_ms=st.integers(0, 3000), length_ms=st.integers(1, 3000))
def test_mean_is_that_of_every_millisecond(commands, start_ms, length_ms):
    history, now_ms, noted = CommandHistory(), 0, []
    for later_ms, power_w in commands:
        now_ms += later_ms
        history = history.noted(now_ms * MS, power_w)
        noted.append((now_ms, power_w))

    def at(instant_ms):
        return next((power_w for since_ms, power_w in reversed(noted) if since_ms <= instant_ms), 0.0)

    every_w = [at(instant_ms) for instant_ms in range(start_ms, start_ms + length_ms)]
    assert history.mean_w(start_ms * MS, (start_ms + length_ms) * MS) == pytest.approx(
        sum(every_w) / length_ms, abs=1e-6)
    assert history.mean_w(start_ms * MS, start_ms * MS) == at(start_ms)


@given(commands=COMMANDS, forgotten_ms=st.integers(0, 5000), later_ms=st.integers(0, 5000))
def test_time_of_heating_is_that_of_every_millisecond(commands, forgotten_ms, later_ms):
    history, now_ms, noted, forgotten = CommandHistory(), 0, [(0, 0.0)], False
    for after_ms, power_w in commands:
        now_ms += after_ms
        if now_ms > forgotten_ms and not forgotten:
            history = history.without_heating(forgotten_ms * MS)
            forgotten = True
        history = history.noted(now_ms * MS, power_w)
        noted.append((now_ms, power_w))
    if not forgotten:
        forgotten_ms = now_ms
        history = history.without_heating(now_ms * MS)
    end_ms = now_ms + later_ms
    ends_ms = [since_ms for since_ms, _ in noted[1:]] + [end_ms]
    heated_ms = sum(max(0, until_ms - max(since_ms, forgotten_ms))
                    for (since_ms, power_w), until_ms in zip(noted, ends_ms) if power_w > 0.0)
    assert history.heated_s(end_ms * MS) == pytest.approx(heated_ms / 1e3, abs=1e-9)


def test_the_last_of_two_commands_at_one_instant_holds():
    history = CommandHistory()
    history = history.noted(5 * MS, 7000.0)
    history = history.noted(5 * MS, 0.0)
    assert history.mean_w(0, 10 * MS) == 0.0
    assert history.mean_w(5 * MS, 5 * MS) == 0.0


def test_a_clock_that_was_set_back_forgets_what_now_lies_ahead():
    history = CommandHistory()
    history = history.noted(1000 * MS, 7000.0)
    history = history.noted(400 * MS, 900.0)
    assert history.mean_w(0, 400 * MS) == 0.0
    assert history.mean_w(400 * MS, 2000 * MS) == 900.0


def test_what_is_kept_reaches_back_far_enough_and_no_further():
    history = CommandHistory()
    for second in range(100_000):
        history = history.noted(second * 1000 * MS, float(second % 2))
    now_ns = 99_999 * 1000 * MS
    assert history.mean_w(now_ns - KEPT_NS, now_ns) == pytest.approx(0.5)
    # Every odd second heated; of the earlier ones nothing is known.
    assert history.power_w(99_997 * 1000 * MS) == 1.0
    forgotten_s = 99_999 - round(2 * KEPT_NS / 1e9)
    assert not any(history.power_w(second * 1000 * MS) for second in range(1, forgotten_s, 1000))


def test_a_command_that_lasts_is_kept_however_old():
    history = CommandHistory()
    history = history.noted(0, 5300.0)
    later_ns = 100 * KEPT_NS
    history = history.noted(later_ns, 5300.0)
    assert history.mean_w(later_ns - KEPT_NS, later_ns) == pytest.approx(5300.0)
