# SPDX-License-Identifier: Apache-2.0
"""
Switches the heater rarely enough: least times on and off, pauses after doubt, a most of switch-ons in an hour.

Instants are integers, in nanoseconds of the node's clock.
"""

from __future__ import annotations

from typing import NamedTuple

from bev_preheat.numerics import NS_PER_S, S_PER_H
from bev_preheat.tunables import AGAIN_WITHIN_S, HELD_OFF_AGAIN_S, HELD_OFF_S, MOST_SWITCH_ONS

_HOUR_NS = round(S_PER_H * NS_PER_S)


class HeatingPause(NamedTuple):
    """
    The pause after doubt, and the switch-ons of the last hour; instants in nanoseconds.

    Only time that passes forward counts, as `elapsed_ns` [ns]: a clock that falls back neither ends a pause nor
    prolongs it. `switch_ons`, `interrupted_ns` (the latest interruption of heating, None: none) and `doubted_ns`
    (None: no pause) are instants of that time; the pause lasts `wait_s` [s], for a `cause` as text.
    """

    now_ns: int | None = None
    elapsed_ns: int = 0
    switch_ons: tuple[int, ...] = ()
    interrupted_ns: int | None = None
    doubted_ns: int | None = None
    wait_s: float = 0.0
    cause: str = ''

    def at(self, now_ns: int) -> HeatingPause:
        """Return the pause at an instant; a pause that is over is forgotten."""
        elapsed_ns = self.elapsed_ns + (0 if self.now_ns is None else max(0, now_ns - self.now_ns))
        is_over = self.doubted_ns is None or self.doubted_ns + round(self.wait_s * NS_PER_S) <= elapsed_ns
        return self._replace(
            now_ns=now_ns, elapsed_ns=elapsed_ns, doubted_ns=None if is_over else self.doubted_ns,
            switch_ons=tuple(each_ns for each_ns in self.switch_ons if elapsed_ns - each_ns < _HOUR_NS))

    def doubted(self, cause: str, was_on: bool) -> HeatingPause:
        """Return the pause begun (again) for a cause as text, if the heater was on or paused."""
        before_ns, wait_s = self.interrupted_ns, self.wait_s
        if was_on:
            is_again = before_ns is not None and self.elapsed_ns - before_ns < AGAIN_WITHIN_S * NS_PER_S
            before_ns, wait_s = self.elapsed_ns, HELD_OFF_AGAIN_S if is_again else HELD_OFF_S
        elif self.doubted_ns is None:
            return self
        return self._replace(interrupted_ns=before_ns, doubted_ns=self.elapsed_ns, wait_s=wait_s, cause=cause)

    def switched_on(self) -> HeatingPause:
        """Return the pause with one more switch-on of the heater."""
        return self._replace(switch_ons=(*self.switch_ons, self.elapsed_ns))

    @property
    def spacing_s(self) -> float:
        """The least time on, and off, that the switch-ons of the last hour ask for [s]."""
        return S_PER_H / MOST_SWITCH_ONS / 2.0 if len(self.switch_ons) >= MOST_SWITCH_ONS // 2 else 0.0

    @property
    def left_s(self) -> float:
        """For how long [s] the heater stays off; 0 if it may be switched on."""
        return max(self._doubt_left_ns(), self._hour_left_ns(), 0) / NS_PER_S

    @property
    def is_for_doubt(self) -> bool:
        """Whether the heater stays off because of doubt."""
        return self._doubt_left_ns() > 0

    @property
    def sentence(self) -> str:
        """Why the heater stays off, and until when; '' if it may be switched on."""
        if self.doubted_ns is not None and self._doubt_left_ns() > 0:
            ago_s = (self.elapsed_ns - self.doubted_ns) / NS_PER_S
            return f'{self.cause} {ago_s:.0f} s ago; heating resumes after {self.wait_s:g} s of valid input.'
        if self._hour_left_ns() > 0:
            return (f'The heater was switched on {len(self.switch_ons)} times within an hour; the next time is '
                    f'possible in {self._hour_left_ns() / NS_PER_S:.0f} s.')
        return ''

    def _doubt_left_ns(self) -> int:
        if self.doubted_ns is None:
            return 0
        return self.doubted_ns + round(self.wait_s * NS_PER_S) - self.elapsed_ns

    def _hour_left_ns(self) -> int:
        """Half of an hour's switch-ons come at once if need be, the others evenly."""
        switch_ons = self.switch_ons
        if len(switch_ons) < MOST_SWITCH_ONS // 2:
            return 0
        again_ns = switch_ons[0] + _HOUR_NS if len(switch_ons) >= MOST_SWITCH_ONS else 0
        return max(switch_ons[-1] + _HOUR_NS // MOST_SWITCH_ONS, again_ns) - self.elapsed_ns


class HeaterSwitch(NamedTuple):
    """
    Least times on and off between a plan's request and the command; instants in nanoseconds.

    They delay requests, never a forced shutdown: `forced_off` and `doubted` take effect at once. After a doubt the
    heater stays off for a while, whatever is requested. `is_held`: it is on only because of the least time.
    `since_ns` is the instant of the latest switching; None: it may be switched at once. `power_w` is the
    command [W].
    """

    is_on: bool = False
    is_held: bool = False
    pause: HeatingPause = HeatingPause()
    since_ns: int | None = None
    power_w: float = 0.0

    def forced_off(self) -> HeaterSwitch:
        """Return the switch off because no heating is needed, or the driver does not want it."""
        return HeaterSwitch(pause=self.pause)

    def turned_off(self, now_ns: int) -> HeaterSwitch:
        """Return the switch off at once because the plan has no more use for heat; the least time off begins."""
        return HeaterSwitch(pause=self.pause, since_ns=now_ns if self.is_on else self.since_ns)

    def doubted(self, now_ns: int, cause: str) -> HeaterSwitch:
        """Return the switch off because something is in doubt, for a cause as text; a pause begins."""
        return HeaterSwitch(pause=self.pause.at(now_ns).doubted(cause, self.is_on))

    def allowed(self) -> HeaterSwitch:
        """Return the switch free to move at once: the reason to wait no longer holds; a pause continues."""
        return self if self.since_ns is None else self._replace(since_ns=None)

    def asked(self, now_ns: int, wanted_w: float, limit_w: float, minimum_on_time_s: float,
              minimum_off_time_s: float) -> HeaterSwitch:
        """Return the switch with the command for `wanted_w` [W], or held on up to `limit_w` [W], or held off."""
        pause, is_on, since_ns = self.pause.at(now_ns), self.is_on, self.since_ns
        wants_on = wanted_w > 0.0
        must_wait = self.must_wait(now_ns, minimum_on_time_s, minimum_off_time_s)
        if wants_on != is_on and not must_wait and not (wants_on and pause.left_s > 0.0):
            is_on, since_ns = wants_on, now_ns
            if wants_on:
                pause = pause.switched_on()
        power_w = 0.0 if not is_on else min(wanted_w if wants_on else self.power_w, limit_w)
        return HeaterSwitch(is_on, is_on and not wants_on, pause, since_ns, power_w)

    def must_wait(self, now_ns: int, minimum_on_time_s: float, minimum_off_time_s: float) -> bool:
        """Return whether the heater may not be switched yet, by its own times."""
        least_s = max(minimum_on_time_s if self.is_on else minimum_off_time_s, self.pause.at(now_ns).spacing_s)
        # After the clock was set back the time since the last switching is unknown.
        return self.since_ns is not None and 0 <= now_ns - self.since_ns < round(least_s * NS_PER_S)

    def held_for_s(self, now_ns: int, minimum_on_time_s: float, minimum_off_time_s: float) -> float:
        """Return the time [s] until the heater may be switched again."""
        if self.since_ns is None:
            return 0.0
        least_s = max(minimum_on_time_s if self.is_on else minimum_off_time_s, self.pause.spacing_s)
        return max(0.0, least_s - (now_ns - self.since_ns) / NS_PER_S)
