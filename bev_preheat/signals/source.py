# SPDX-License-Identifier: Apache-2.0
"""
Whether the battery states are from one battery, and arrive often enough for heating.

Two batteries on one topic contradict each other: temperature, charge or voltage jump back and forth
between consecutive messages, faster than any battery can. Or `location` or `serial_number` changes. The
traction battery cannot be distinguished from the other battery.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from bev_preheat.errors import quoted

# Largest changes between consecutive states of one battery: [K], (0 ... 1), share of the voltage.
JUMP_K = 4.0
JUMP_SOC = 0.03
JUMP_VOLTAGE = 0.2
# Fastest change of the temperature [K/s], for states that are far apart.
RATE_K_PER_S = 0.1
# States further apart than this [s] are not compared.
TOGETHER_S = 30.0
# Two batteries: at least LEAST_JUMPS among the latest STATES.
STATES = 20
LEAST_JUMPS = 3
# Number of consecutive states without a jump that end the doubt.
CALM_STATES = 30
# After this many long gaps in a row the feed is slow, after this many short ones it is steady again.
SLOW_GAPS, STEADY_GAPS = 2, 3


class SeenState(NamedTuple):
    """A battery state: instant [s], temperature [deg C], charge (0 ... 1), voltage [V], name ('': none)."""

    instant_s: float
    temperature_c: float
    soc: float
    voltage_v: float | None
    name: str


class SourceWatch:
    """Watches from which battery states come; `doubt` is the sentence, '' if it is one battery."""

    def __init__(self) -> None:
        """Start without states."""
        self.doubt = ''
        self._before: SeenState | None = None
        self._jumps: deque[bool] = deque(maxlen=STATES)
        self._calm = 0

    def lose_time(self) -> None:
        """Forget the latest state, because the next one does not follow it."""
        self._before = None

    def see(self, instant_s: float, temperature_c: float, soc: float, voltage_v: float | None,
            name: str = '') -> str:
        """
        Update with instant [s], temperature [deg C], state of charge (0 ... 1), voltage [V].

        `name` identifies the battery in the message, '' if it does not. Returns `doubt`.
        """
        state = SeenState(instant_s, temperature_c, soc, voltage_v, name)
        before, self._before = self._before, state
        if before is None or not 0.0 <= instant_s - before.instant_s <= TOGETHER_S:
            self._jumps.clear()
            return self.doubt
        has_jumped = before.name != state.name or bool(_jumping(before, state))
        self._jumps.append(has_jumped)
        self._calm = 0 if has_jumped else self._calm + 1
        if sum(self._jumps) >= LEAST_JUMPS:
            self.doubt = self._sentence(before, state) if has_jumped or not self.doubt else self.doubt
        elif self._calm >= CALM_STATES:
            self.doubt = ''
        return self.doubt

    def _sentence(self, one: SeenState, other: SeenState) -> str:
        if one.name != other.name:
            names = ' and '.join(quoted(each.name) if each.name else 'one without a name' for each in (one, other))
            return f'battery_state comes from two batteries: {names}; remap the topic to the traction battery'
        share = 100.0 * sum(self._jumps) / len(self._jumps)
        jumping = _jumping(one, other)
        # A noisy sensor looks like a second battery that differs in one signal.
        lone = f', or its {jumping[0]} jumps' if len(jumping) == 1 else ''
        return (f'battery_state comes from two batteries{lone}: {share:.0f} % of the readings contradict the one '
                f'before, {_in_words(one)} and {_in_words(other)}; remap the topic to the traction battery')


def is_one_battery(one: SeenState, other: SeenState) -> bool:
    """Return whether two states may be of one battery."""
    return one.name == other.name and not _jumping(one, other)


def _jumping(one: SeenState, other: SeenState) -> list[str]:
    """Return the signals that change from one state to the next faster than those of a battery."""
    elapsed_s = other.instant_s - one.instant_s
    jumps = {
        'temperature': abs(other.temperature_c - one.temperature_c) > max(JUMP_K, RATE_K_PER_S * elapsed_s),
        'state of charge': abs(other.soc - one.soc) > JUMP_SOC,
        'voltage': one.voltage_v is not None and other.voltage_v is not None and (
            abs(other.voltage_v - one.voltage_v) > JUMP_VOLTAGE * max(one.voltage_v, other.voltage_v))}
    return [signal for signal, has_jumped in jumps.items() if has_jumped]


def _in_words(state: SeenState) -> str:
    voltage = '' if state.voltage_v is None else f', {state.voltage_v:.0f} V'
    return f'{state.temperature_c:.1f} degC, {100 * state.soc:.1f} %{voltage}'


class FeedWatch:
    """Compares the time between valid battery states with the allowed time."""

    def __init__(self) -> None:
        """Start without states."""
        self._latest_s: float | None = None
        self._too_long_s: deque[float] = deque(maxlen=SLOW_GAPS)
        self._in_time = 0
        self._is_slow = self._has_expired = False

    def note_expired(self) -> None:
        """Note that the latest state is too old, and no other has arrived."""
        self._has_expired = True

    def lose_time(self) -> None:
        """Forget when the latest state arrived, because the clock was restarted."""
        self._latest_s, self._has_expired = None, False

    def see(self, instant_s: float, timeout_s: float) -> str:
        """
        Return the doubt about the feed after a state with the stamp `instant_s` [s]; '' while it is steady.

        A state is too old after `timeout_s` [s]; a gap counts as too long if that was noted within it.
        """
        if self._latest_s is not None:
            self._count(instant_s - self._latest_s)
        self._latest_s, self._has_expired = instant_s, False
        if not self._is_slow:
            return ''
        every_s = sum(self._too_long_s) / len(self._too_long_s)
        return (f'battery_state arrives every {every_s:.1f} s; battery_state_timeout is {timeout_s:g} s: '
                'raise it, or send battery_state more often')

    def _count(self, gap_s: float) -> None:
        if self._has_expired:
            self._in_time = 0
            self._too_long_s.append(gap_s)
            self._is_slow = self._is_slow or len(self._too_long_s) == SLOW_GAPS
            return
        self._in_time += 1
        if not self._is_slow or self._in_time >= STEADY_GAPS:
            self._is_slow = False
            self._too_long_s.clear()
