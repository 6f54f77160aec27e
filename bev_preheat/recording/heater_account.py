# SPDX-License-Identifier: Apache-2.0
"""The heater's energy along a drive, spans without a valid command, and the share of commanded power delivered."""

from __future__ import annotations

from array import array
from bisect import bisect_right
import math
from typing import TYPE_CHECKING

from bev_preheat.control.heater import HOLD_AT_ONCE
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.numerics import NS_PER_S
from bev_preheat.recording.flight import moment, Period
from bev_preheat.tunables import FAILURE_S, FAULTY
from bev_preheat.vehicle.description import HVCH
from bev_preheat.vehicle.heater_controller import Refusal

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bev_preheat.control.heater import HeaterStatus
    from bev_preheat.control.state import State
    from bev_preheat.recording.flight import Flight
    from bev_preheat.recording.replay import Played
    from bev_preheat.vehicle.description import Vehicle
    from bev_preheat_msgs.msg import HeatSourceStatus, HvchStatus

WH_PER_W_NS = 1.0 / 3600.0 / NS_PER_S
# An answer of the heater's controller holds this long without another one [ns].
ANSWER_HOLDS_NS = 5 * NS_PER_S
# The recorded power of a log's heater holds this long without another one, and answers that far apart belong
# together [ns].
RECORDED_HOLD_NS = 60 * NS_PER_S
# A longer time between two steps is a clock that was set [ns].
LONGEST_SPAN_NS = 86400 * NS_PER_S
KEPT_SPANS = 10_000
# With these the heater's controller has no command that it may follow.
WITHOUT = frozenset((Refusal.NO_COMMAND, Refusal.INVALID_COMMAND, Refusal.INVALID_LEASE, Refusal.COMMAND_CONFLICT))
# A heater that is asked for less shows nothing [W].
LEAST_W = 50.0
# A smaller deficit is that of measurement.
FULL_FROM = 0.9
NO_HEAT = 0.01
# Heating with shorter breaks is one heating [ns].
LONGEST_BREAK_NS = 600 * NS_PER_S
# In this time of heating a heater fails as probably as it had failed before [ns].
SOON_NS = round(FAULTY * FAILURE_S * NS_PER_S)


class HeaterAccount:
    """
    Adds up the heater's energy; `command` and `answer` take the instants in order.

    A command counts until the next one or the end of its lease. Between two answers of the heater's controller
    (`hvch_status`) the mean of their powers counts, and after the last one before a long silence its power for
    ANSWER_HOLDS_NS. Without a valid command is the heater after the end of a lease, and
    while its controller reports that it has none: the controller's clock may be ahead of the planner's.
    """

    def __init__(self) -> None:
        self._commanded_wh = self._delivered_wh = 0.0
        # Instant [ns], power [W] and end [ns] of the latest command and of the latest delivery.
        self._command: tuple[int, float, int] | None = None
        self._answer: tuple[int, float, int] | None = None
        self._lapsed: list[Period] = []
        self._unserved: list[Period] = []
        self._is_unserved = False

    def command(self, now_ns: int, power_w: float, until_ns: int) -> None:
        """Take the command [W] that holds at an instant, and the end of its lease [ns]."""
        if self._command is not None:
            before_ns, before_w, end_ns = self._command
            self._commanded_wh += before_w * _held_ns(before_ns, now_ns, end_ns) * WH_PER_W_NS
            if max(before_ns, end_ns) < now_ns <= before_ns + LONGEST_SPAN_NS:
                _add(self._lapsed, max(before_ns, end_ns), now_ns)
        self._command = now_ns, power_w, until_ns

    def deliver(self, now_ns: int, power_w: float, until_ns: int) -> None:
        """Take the delivered power [W] from an instant on, until the next one or `until_ns` [ns]."""
        if self._answer is not None:
            before_ns, before_w, end_ns = self._answer
            self._delivered_wh += before_w * _held_ns(before_ns, now_ns, end_ns) * WH_PER_W_NS
        self._answer = now_ns, power_w, until_ns

    def answer(self, status: HeaterStatus) -> None:
        """Take an answer of the heater's controller; a repeated answer counts once."""
        now_ns, before = status.stamp_ns, self._answer
        if before is not None and before[0] == now_ns:
            return
        if self._is_unserved and before is not None and before[0] < now_ns:
            _add(self._unserved, before[0], min(now_ns, before[2]))
        if before is not None and 0 < now_ns - before[0] <= RECORDED_HOLD_NS:
            self._answer = before[0], 0.5 * (before[1] + status.confirmed_w), now_ns
        self.deliver(now_ns, status.confirmed_w, now_ns + ANSWER_HOLDS_NS)
        # Before the planner's first command there is nothing to serve.
        self._is_unserved = status.refusal in WITHOUT and self._command is not None

    @property
    def commanded_wh(self) -> float | None:
        """The commanded energy [Wh]; None: there was no command."""
        return None if self._command is None else self._commanded_wh

    @property
    def delivered_wh(self) -> float | None:
        """The delivered energy [Wh]; None: nothing reported it."""
        return None if self._answer is None else self._delivered_wh

    @property
    def without_command(self) -> list[Period]:
        """The spans without a valid command, in order."""
        return united([*self._lapsed, *self._unserved])

    def latest_without_command(self, most: int) -> list[Period]:
        """Return some of the spans without a valid command: those among the latest ones, in order."""
        return united([*self._lapsed[-most:], *self._unserved[-most:]])[-most:]


def united(spans: Iterable[Period]) -> list[Period]:
    """Return the union of spans, in order."""
    found: list[Period] = []
    for span in sorted(spans):
        _add(found, *span)
    return found


def _held_ns(before_ns: int, now_ns: int, end_ns: int) -> int:
    return max(min(now_ns, end_ns) - before_ns, 0)


def _add(spans: list[Period], from_ns: int, to_ns: int) -> None:
    """Add a span that begins no earlier than the last one; it continues that if they touch."""
    if spans and spans[-1].from_ns <= from_ns <= spans[-1].to_ns:
        spans[-1] = Period(spans[-1].from_ns, max(spans[-1].to_ns, to_ns))
    elif to_ns > from_ns:
        spans.append(Period(from_ns, to_ns))
        # Of a command that fails for days the latest spans are kept.
        del spans[:-KEPT_SPANS]


class HeaterShares:
    """
    The share (0 ... 1) by the number of the step; `add` takes the steps of the unchanged replay.

    It is that of the heat source of a name, by its status, else the estimated one. A fault that was suspected soon
    after heating began counts from that beginning on, another one from the suspicion on. A source that is dead or
    stuck on does not follow any command: 0.
    """

    def __init__(self, flight: Flight, name: str = HVCH) -> None:
        self._name, self._given = name, flight.given
        self._is_log = flight.is_log
        self._steps, self._from, self._shares = 0, [0], [1.0]
        self._suspected_s = 0.0
        self._by_status = False
        # The number of the step that the present heating began with, and the instant of the latest heat [ns].
        self._heating, self._heated_ns = 0, 0

    def add(self, played: Played) -> None:
        """Take the next step."""
        number, self._steps = self._steps, self._steps + 1
        if self._is_log:
            # Its power is that of the heater, not a command.
            return
        self._look_at_command(number)
        share = self._share(played.state)
        if share == self._shares[-1]:
            return
        if self._shares[-1] == 1.0 and not self._by_status:
            number = max(self._begin(number), self._from[-1] + 1)
        self._from.append(number)
        self._shares.append(share)

    def at(self, number: int) -> float:
        """Return the share at a step."""
        return self._shares[bisect_right(self._from, number) - 1]

    @property
    def sentence(self) -> str:
        """The sentence on a heater that did not deliver its command, and what changed drives count; '' else."""
        weak = [(self._given[number].step.now_ns, share) for number, share in zip(self._from, self._shares)
                if share < FULL_FROM]
        if not weak:
            return ''
        least = min(share for _, share in weak)
        gave = 'no heat for its command' if least < NO_HEAT else f'only {100.0 * least:.0f} % of its command'
        name = 'heater' if self._name == HVCH else self._name
        return (f'the recorded {name} gave {gave} (least share, first deficit seen {moment(weak[0][0])}); the '
                'changed drive counts the shares that the recording shows')

    def _look_at_command(self, number: int) -> None:
        step = self._given[number].step
        if step.command is not None and step.command_w(self._name) >= LEAST_W:
            if step.now_ns - self._heated_ns > LONGEST_BREAK_NS:
                self._heating = number
            self._heated_ns = step.now_ns

    def _begin(self, number: int) -> int:
        """Return the step from which a fault counts that is reported at a step."""
        suspected_ns = self._given[number].step.now_ns - round(self._suspected_s * NS_PER_S)
        if suspected_ns - self._given[self._heating].step.now_ns < SOON_NS:
            return self._heating
        while number > 0 and self._given[number - 1].step.now_ns >= suspected_ns:
            number -= 1
        return number

    def _share(self, state: State) -> float:
        is_hvch, estimate = self._name == HVCH, state.estimate
        for answers in state.answers.of_all:
            if answers.name == self._name and answers.status is not None and answers.are_used(
                    state.now_ns, state.settings):
                self._by_status = True
                return _share_of(answers.status, self._shares[-1])
        self._by_status = False
        report = (state.source_reports.get(self._name) if not is_hvch else
                  None if estimate is None else estimate.heater)
        if report is None:
            return 1.0
        if report.suspected is not None:
            self._suspected_s = report.suspected.lasts_s
        return {Heater.ANSWERS: 1.0, Heater.DERATED: report.share}.get(report.heater, 0.0)


class RecordedHeat:
    """The HeaterShares of a vehicle's heat sources along an unchanged replay, and the temperature of the air."""

    def __init__(self, flight: Flight, vehicle: Vehicle) -> None:
        self._shares = {name: HeaterShares(flight, name) for name in (
            HVCH, *(source.name for source in vehicle.heat_sources))}
        self._ambient_c = array('d')

    def add(self, played: Played) -> None:
        """Take the next step."""
        for shares in self._shares.values():
            shares.add(played)
        ambient = played.state.preparation.ambient
        self._ambient_c.append(math.nan if ambient is None else ambient[1])

    def share_at(self, number: int, name: str) -> float:
        """Return the share that a source delivers at a step; an unknown source delivers 0."""
        return self._shares[name].at(number) if name in self._shares else 0.0

    def ambient_c(self, number: int) -> float:
        """Return the temperature of the air at a step [deg C]; NaN: unknown."""
        return self._ambient_c[number] if number < len(self._ambient_c) else math.nan

    @property
    def sentence(self) -> str:
        """The sentences on sources that did not deliver their commands; '' else."""
        return '; '.join(filter(None, (shares.sentence for shares in self._shares.values())))


def _share_of(status: HeaterStatus, before: float) -> float:
    if status.refusal in HOLD_AT_ONCE and status.active_w < LEAST_W:
        return 0.0
    if status.requested_w < LEAST_W or status.refusal is Refusal.RATE_LIMITED:
        return before
    return min(status.confirmed_w / status.requested_w, 1.0)


def alter_status(message: HvchStatus | HeatSourceStatus, command_w: float, share: float) -> None:
    """Let an answer of the heater's controller be the one to another command [W], delivered with a share."""
    if message.refusal not in HOLD_AT_ONCE:
        message.active_power = command_w if message.measured_power_known else share * command_w
        if message.refusal == Refusal.NO_COMMAND and command_w > 0.0:
            message.refusal, message.explanation = int(Refusal.NOT_REFUSED), ''
    message.requested_power = command_w
    if message.measured_power_known:
        message.measured_power = share * command_w
