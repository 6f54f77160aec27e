# SPDX-License-Identifier: Apache-2.0
"""
The heater's power: as commanded, as its controller answers (`hvch_status`), and rarely enough switched.

Without answers the planner takes its own commands for the heater's power, as it does once they are silent or
doubted. Instants are integers, in nanoseconds of the node's clock.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.errors import age_beyond, InvalidInput
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.numerics import NS_PER_S, S_PER_H
from bev_preheat.tunables import (
    COMPARED_OVER_NS,
    CONFIRMED_WITHIN_S,
    FIRST_WAIT_S,
    INTERRUPTIONS_OVER_S,
    LEAST_DIFFERENCE_W,
    LEAST_LONGEST_WAIT_S,
    MOST_SWITCH_ONS,
)
from bev_preheat.vehicle.heater_controller import Refusal

if TYPE_CHECKING:
    from bev_preheat.control.settings import Settings
    from bev_preheat.estimation.hypotheses import HeaterReport

# No caller asks further back.
KEPT_NS = 70_000_000_000
NO_CHANGES: tuple[tuple[int, float], ...] = ((0, 0.0),)


@dataclass(frozen=True)
class CommandHistory:
    """
    The heater's commanded power [W] over the last minutes; instants in nanoseconds.

    `changes` are the instants of changes with the power after each; `heated_ns` is the time of heating up to the
    latest change, since `without_heating`.
    """

    changes: tuple[tuple[int, float], ...] = NO_CHANGES
    heated_ns: int = 0

    def noted(self, instant_ns: int, power_w: float) -> CommandHistory:
        """Return the history with `power_w` commanded from an instant on; instants do not fall."""
        # A clock that was set back voids earlier entries.
        changes = NO_CHANGES if self.changes[-1][0] > instant_ns else self.changes
        if changes[-1][1] == power_w:
            return self if changes is self.changes else replace(self, changes=changes)
        heated_ns = self.heated_ns + _heating_for_ns(changes, instant_ns)
        changes = (*changes, (instant_ns, power_w))
        while len(changes) > 2 and changes[1][0] < instant_ns - KEPT_NS:
            changes = changes[1:]
        return CommandHistory(changes, heated_ns)

    def heating_for_s(self, now_ns: int) -> float:
        """Return for how long [s] the latest power, if it is not 0, has been commanded."""
        return _heating_for_ns(self.changes, now_ns) / NS_PER_S

    def heated_s(self, now_ns: int) -> float:
        """Return for how long [s] heating has been commanded since `without_heating`."""
        return (self.heated_ns + _heating_for_ns(self.changes, now_ns)) / NS_PER_S

    def without_heating(self, now_ns: int) -> CommandHistory:
        """Return the history that counts the time of heating from 0 again, because another drive begins."""
        return replace(self, heated_ns=-_heating_for_ns(self.changes, now_ns))

    def mean_w(self, from_ns: int, to_ns: int) -> float:
        """Return the mean commanded power [W] between two instants; the power then if they are equal."""
        if to_ns <= from_ns:
            return self.power_w(to_ns)
        later_ns, energy = to_ns, 0.0
        for changed_ns, power_w in reversed(self.changes):
            if changed_ns >= later_ns:
                continue
            start_ns = max(changed_ns, from_ns)
            energy += power_w * (later_ns - start_ns)
            later_ns = start_ns
            if later_ns <= from_ns:
                break
        return energy / (to_ns - from_ns)

    def power_w(self, instant_ns: int) -> float:
        """Return the power [W] that was commanded at an instant."""
        for changed_ns, power_w in reversed(self.changes):
            if changed_ns <= instant_ns:
                return power_w
        return 0.0


def _heating_for_ns(changes: tuple[tuple[int, float], ...], now_ns: int) -> int:
    since_ns, power_w = changes[-1]
    return max(0, now_ns - since_ns) if power_w > 0.0 else 0


HEATER_STATUS = 'hvch_status'
# These do not depend on a command: they hold at once.
HOLD_AT_ONCE = frozenset((Refusal.HEATER_FAULT, Refusal.LOW_CHARGE, Refusal.HOT_BATTERY, Refusal.IN_MOTION))
IN_WORDS = {
    Heater.DERATED: 'battery temperature and power show less heat than it reports',
    Heater.DEAD: 'battery temperature and power show no heat',
    Heater.STUCK_ON: 'battery temperature and power show more heat than it reports',
}


class HeaterStatus(NamedTuple):
    """An answer at an instant [ns]: powers [W], None: not measured, and the Refusal with its sentence."""

    stamp_ns: int
    requested_w: float
    active_w: float
    refusal: Refusal = Refusal.NOT_REFUSED
    sentence: str = ''
    measured_w: float | None = None

    @property
    def confirmed_w(self) -> float:
        """The confirmed power [W]: the measured one if there is one."""
        return self.active_w if self.measured_w is None else self.measured_w


class HeaterAnswerReport(NamedTuple):
    """
    The latest HeaterStatus (None: all were refused), and sentences on it; '' for none.

    On the heater's refusal, on the doubt about the answers, on their silence, and on the latest unreadable one.
    """

    status: HeaterStatus | None
    refusal: str = ''
    doubt: str = ''
    silence: str = ''
    problem: str = ''


class HeaterAnswers(NamedTuple):
    """
    The latest HeaterStatus and the history of the heater's power; a value: each answer makes another one.

    `history` has the confirmed power while the answers are used, otherwise the commanded one. `doubt` is the
    sentence on answers that are contradicted, `problem` that on the latest unreadable one; '' for none. `status`
    None: no answer yet, commands count as served.
    """

    history: CommandHistory = CommandHistory()
    status: HeaterStatus | None = None
    doubt: str = ''
    problem: str = ''

    def with_answer(self, status: HeaterStatus, now_ns: int, settings: Settings) -> HeaterAnswers:
        """Return the answers with a HeaterStatus; raise InvalidInput if its stamp is implausible."""
        age_s = (now_ns - status.stamp_ns) / NS_PER_S
        oldest_s, ahead_s = settings.battery_state_timeout_s, settings.clock_tolerance_s
        if not -ahead_s <= age_s <= oldest_s:
            raise InvalidInput(f'header.stamp: the status is {age_beyond(age_s, ahead_s, oldest_s)}')
        if self.status is not None and status.stamp_ns < self.status.stamp_ns <= now_ns + ahead_s * NS_PER_S:
            # Overtaken.
            return self
        history = self.history if self.doubt else self.history.noted(now_ns, status.confirmed_w)
        return self._replace(status=status, problem='', history=history)

    def with_problem(self, error: InvalidInput) -> HeaterAnswers:
        """Return the answers after a status that could not be used."""
        return self._replace(problem=f'{HEATER_STATUS} refused: {error}')

    def with_command(self, now_ns: int, power_w: float, settings: Settings) -> HeaterAnswers:
        """Return the answers after a command [W]; it counts as served while no answer is used."""
        return self if self.are_used(now_ns, settings) else self._replace(
            history=self.history.noted(now_ns, power_w))

    def without_heating(self, now_ns: int) -> HeaterAnswers:
        """Return the answers that count the time of heating from 0 again, because another drive begins."""
        return self._replace(history=self.history.without_heating(now_ns))

    def are_used(self, now_ns: int, settings: Settings) -> bool:
        """Return whether the latest answer is recent and not doubted."""
        return not self.doubt and self._is_recent(now_ns, settings)

    def _is_recent(self, now_ns: int, settings: Settings) -> bool:
        return self.status is not None and abs(
            now_ns - self.status.stamp_ns) <= settings.battery_state_timeout_s * NS_PER_S

    def refusal(self, now_ns: int, settings: Settings, commands: CommandHistory) -> str:
        """Return the sentence on heat that the heater refuses at an instant; '' if it does not."""
        status = self.status
        if status is None or not self.are_used(now_ns, settings) or status.confirmed_w > 0.0:
            return ''
        if status.refusal not in HOLD_AT_ONCE and commands.heating_for_s(now_ns) < CONFIRMED_WITHIN_S:
            return ''
        reason = status.sentence or status.refusal.name.lower().replace('_', ' ')
        if status.refusal is Refusal.NOT_REFUSED:
            reason = f'it reports {status.confirmed_w:.0f} W'
        return f'The heater does not heat ({status.refusal.name}): {reason.rstrip(".")}.'

    def judged(self, report: HeaterReport, now_ns: int, settings: Settings,
               commands: CommandHistory) -> tuple[HeaterAnswers, bool]:
        """Return the answers, in doubt if a HeaterReport contradicts them, and whether it falls with them."""
        if self.status is None or report.heater is Heater.ANSWERS or not self.are_used(now_ns, settings):
            return self, False
        doubt = (f'{HEATER_STATUS} is in doubt: it reports {self.status.confirmed_w:.0f} W, but '
                 f'{IN_WORDS[report.heater]} (probability {100.0 * report.probability:.1f} %); the planner '
                 'goes by battery temperature and power')
        from_ns = now_ns - COMPARED_OVER_NS
        return self._replace(doubt=doubt), abs(commands.mean_w(from_ns, now_ns) - self.history.mean_w(
            from_ns, now_ns)) > LEAST_DIFFERENCE_W

    def on_new_trip(self, now_ns: int) -> HeaterAnswers:
        """Return the answers at the beginning of a trip: they are trusted again, and nothing has been heated."""
        return self._replace(doubt='').without_heating(now_ns)

    def without_instants(self) -> HeaterAnswers:
        """Return the answers without the latest one, because the clock was restarted."""
        return self._replace(status=None)

    def report(self, now_ns: int, settings: Settings, refusal: str) -> HeaterAnswerReport | None:
        """Return the HeaterAnswerReport of an instant; None before the first answer."""
        if self.status is None and not self.problem:
            return None
        silence = ''
        if self.status is not None and not self._is_recent(now_ns, settings):
            silence = (f'{HEATER_STATUS} is {(now_ns - self.status.stamp_ns) / NS_PER_S:.0f} s old; commands '
                       'count as served')
        return HeaterAnswerReport(self.status, refusal, self.doubt, silence, self.problem)


class HeatingPause(NamedTuple):
    """
    The pause after doubt, and the switch-ons of the last hour; instants in nanoseconds.

    Only time that passes forward counts, as `elapsed_ns` [ns]: a clock that falls back neither ends a pause nor
    prolongs it. `interruptions`, `switch_ons` and `doubted_ns` (None: no pause) are instants of that time;
    the pause lasts `wait_ns` [ns], for a `cause` as text.
    """

    now_ns: int | None = None
    elapsed_ns: int = 0
    interruptions: tuple[int, ...] = ()
    switch_ons: tuple[int, ...] = ()
    doubted_ns: int | None = None
    wait_ns: int = 0
    cause: str = ''

    def at(self, now_ns: int) -> HeatingPause:
        """Return the pause at an instant; a pause that is over is forgotten."""
        elapsed_ns = self.elapsed_ns + (0 if self.now_ns is None else max(0, now_ns - self.now_ns))
        is_over = self.doubted_ns is None or self.doubted_ns + self.wait_ns <= elapsed_ns
        return self._replace(
            now_ns=now_ns, elapsed_ns=elapsed_ns, doubted_ns=None if is_over else self.doubted_ns,
            interruptions=_within(self.interruptions, elapsed_ns, INTERRUPTIONS_OVER_S),
            switch_ons=_within(self.switch_ons, elapsed_ns, S_PER_H))

    def doubted(self, cause: str, was_on: bool, minimum_off_time_s: float) -> HeatingPause:
        """Return the pause begun (again) for a cause as text; each interruption of heating makes it longer."""
        interruptions, wait_ns = self.interruptions, self.wait_ns
        if was_on:
            interruptions = (*interruptions, self.elapsed_ns)
            longest_s = max(minimum_off_time_s, LEAST_LONGEST_WAIT_S)
            doublings = min(len(interruptions) - 1, 10)
            wait_ns = round(min(FIRST_WAIT_S * 2.0 ** doublings, longest_s) * NS_PER_S)
        elif self.doubted_ns is None:
            return self
        return self._replace(interruptions=interruptions, wait_ns=wait_ns, doubted_ns=self.elapsed_ns, cause=cause)

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
            number = len(self.interruptions)
            again = f' (interruption {number} in {INTERRUPTIONS_OVER_S / 60.0:g} min)' if number > 1 else ''
            return (f'{self.cause} {ago_s:.0f} s ago; heating resumes after {self.wait_ns / NS_PER_S:g} s of '
                    f'valid input{again}.')
        if self._hour_left_ns() > 0:
            return (f'The heater was switched on {MOST_SWITCH_ONS} times within an hour; the next time is '
                    f'possible in {self._hour_left_ns() / NS_PER_S:.0f} s.')
        return ''

    def _doubt_left_ns(self) -> int:
        if self.doubted_ns is None:
            return 0
        return self.doubted_ns + self.wait_ns - self.elapsed_ns

    def _hour_left_ns(self) -> int:
        if len(self.switch_ons) < MOST_SWITCH_ONS:
            return 0
        return self.switch_ons[0] + round(S_PER_H * NS_PER_S) - self.elapsed_ns


def _within(instants_ns: tuple[int, ...], now_ns: int, kept_s: float) -> tuple[int, ...]:
    """Return the instants of the last `kept_s` [s]."""
    while instants_ns and now_ns - instants_ns[0] >= kept_s * NS_PER_S:
        instants_ns = instants_ns[1:]
    return instants_ns


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

    def doubted(self, now_ns: int, cause: str, minimum_off_time_s: float) -> HeaterSwitch:
        """Return the switch off because something is in doubt, for a cause as text; a pause begins."""
        return HeaterSwitch(pause=self.pause.at(now_ns).doubted(cause, self.is_on, minimum_off_time_s))

    def allowed(self) -> HeaterSwitch:
        """Return the switch free to move at once: the reason to wait no longer holds; a pause continues."""
        return self if self.since_ns is None else self._replace(since_ns=None)

    def asked(self, now_ns: int, wanted_w: float, limit_w: float, minimum_on_time_s: float,
              minimum_off_time_s: float) -> HeaterSwitch:
        """Return the switch with the command for `wanted_w` [W], or held on up to `limit_w` [W], or held off."""
        pause, is_on, since_ns = self.pause.at(now_ns), self.is_on, self.since_ns
        wants_on = wanted_w > 0.0
        least_s = max(minimum_on_time_s if is_on else minimum_off_time_s, pause.spacing_s)
        # After the clock was set back the time since the last switching is unknown.
        must_wait = since_ns is not None and 0 <= now_ns - since_ns < round(least_s * NS_PER_S)
        if wants_on != is_on and not must_wait and not (wants_on and pause.left_s > 0.0):
            is_on, since_ns = wants_on, now_ns
            if wants_on:
                pause = pause.switched_on()
        power_w = 0.0 if not is_on else min(wanted_w if wants_on else self.power_w, limit_w)
        return HeaterSwitch(is_on, is_on and not wants_on, pause, since_ns, power_w)

    def held_for_s(self, now_ns: int, minimum_on_time_s: float, minimum_off_time_s: float) -> float:
        """Return the time [s] until the heater may be switched again."""
        if self.since_ns is None:
            return 0.0
        least_s = max(minimum_on_time_s if self.is_on else minimum_off_time_s, self.pause.spacing_s)
        return max(0.0, least_s - (now_ns - self.since_ns) / NS_PER_S)
