# SPDX-License-Identifier: Apache-2.0
"""
Whether the battery states are from one battery, and arrive often enough for heating.

Two batteries on one topic contradict each other: temperature, charge or voltage jump back and forth
between consecutive messages, faster than any battery can. Or `location` or `serial_number` changes. The
traction battery cannot be distinguished from the other battery.
"""

from __future__ import annotations

from typing import NamedTuple

from bev_preheat.errors import quoted
from bev_preheat.tunables import (
    COMPARED_STATES,
    LEAST_JUMPS,
    OTHER_PACK_K,
    OTHER_PACK_SOC,
    OTHER_PACK_VOLTAGE,
    PACK_RATE_K_PER_S,
    SHORT_GAP_S,
    SLOW_GAPS,
)


class SeenState(NamedTuple):
    """A battery state: instant [s], temperature [deg C], charge (0 ... 1), voltage [V], name ('': none)."""

    instant_s: float
    temperature_c: float
    soc: float
    voltage_v: float | None
    name: str = ''


class SourceWatch(NamedTuple):
    """
    From which battery the states come; `doubt` is the sentence, '' if it is one battery.

    `before` is the latest state, None if the next one does not follow it. `jumps`: whether each of the latest
    states contradicted the one before.
    """

    doubt: str = ''
    before: SeenState | None = None
    jumps: tuple[bool, ...] = ()

    def without_instants(self) -> SourceWatch:
        """Return the watch whose next state does not follow the latest one."""
        return self._replace(before=None)

    def seen(self, state: SeenState) -> SourceWatch:
        """Return the watch after another state."""
        before = self.before
        if before is None or not 0.0 <= state.instant_s - before.instant_s <= SHORT_GAP_S:
            return self._replace(before=state, jumps=())
        has_jumped = not is_one_battery(before, state)
        doubt, jumps = self.doubt, (*self.jumps, has_jumped)[-COMPARED_STATES:]
        if sum(jumps) >= LEAST_JUMPS:
            doubt = _sentence(before, state, jumps) if has_jumped or not doubt else doubt
        elif not any(jumps) and len(jumps) == COMPARED_STATES:
            doubt = ''
        return SourceWatch(doubt, state, jumps)


def _sentence(one: SeenState, other: SeenState, jumps: tuple[bool, ...]) -> str:
    if one.name != other.name:
        names = ' and '.join(quoted(each.name) if each.name else 'one without a name' for each in (one, other))
        return f'battery_state comes from two batteries: {names}; remap the topic to the traction battery'
    share = 100.0 * sum(jumps) / len(jumps)
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
        'temperature': abs(other.temperature_c - one.temperature_c) > max(
            OTHER_PACK_K, PACK_RATE_K_PER_S * elapsed_s),
        'state of charge': abs(other.soc - one.soc) > OTHER_PACK_SOC,
        'voltage': one.voltage_v is not None and other.voltage_v is not None and (
            abs(other.voltage_v - one.voltage_v) > OTHER_PACK_VOLTAGE * max(one.voltage_v, other.voltage_v))}
    return [signal for signal, has_jumped in jumps.items() if has_jumped]


def _in_words(state: SeenState) -> str:
    voltage = '' if state.voltage_v is None else f', {state.voltage_v:.0f} V'
    return f'{state.temperature_c:.1f} degC, {100 * state.soc:.1f} %{voltage}'


class FeedWatch(NamedTuple):
    """
    The time between valid battery states, compared with the allowed time.

    `latest_s` [s] is the latest state's stamp, None: unknown; `has_expired`: it is too old, and no other has
    arrived. `too_long_s` are the latest gaps that were too long [s], `in_time` is the number of others since.
    """

    latest_s: float | None = None
    has_expired: bool = False
    too_long_s: tuple[float, ...] = ()
    in_time: int = 0

    def expired(self) -> FeedWatch:
        """Return the watch whose latest state is too old."""
        return self if self.has_expired else self._replace(has_expired=True)

    def without_instants(self) -> FeedWatch:
        """Return the watch that does not know when the latest state arrived."""
        return self._replace(latest_s=None, has_expired=False)

    def seen(self, instant_s: float) -> FeedWatch:
        """Return the watch after a state with the stamp `instant_s` [s]."""
        if self.latest_s is None:
            return self._replace(latest_s=instant_s, has_expired=False)
        if self.has_expired:
            gap_s = instant_s - self.latest_s
            return FeedWatch(instant_s, too_long_s=(*self.too_long_s, gap_s)[-SLOW_GAPS:])
        in_time = self.in_time + 1
        return FeedWatch(instant_s, too_long_s=(
            self.too_long_s if self._is_slow and in_time < SLOW_GAPS else ()), in_time=in_time)

    @property
    def _is_slow(self) -> bool:
        return len(self.too_long_s) == SLOW_GAPS

    def doubt(self, timeout_s: float) -> str:
        """Return the sentence on a feed whose states are too old after `timeout_s` [s]; '' while it is steady."""
        if not self._is_slow:
            return ''
        every_s = sum(self.too_long_s) / len(self.too_long_s)
        return (f'battery_state arrives every {every_s:.1f} s; battery_state_timeout is {timeout_s:g} s: '
                'raise it, or send battery_state more often')
