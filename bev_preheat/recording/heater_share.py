# SPDX-License-Identifier: Apache-2.0
"""The share of its command that the recorded heater delivered, for drives with another command."""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING

from bev_preheat.control.heater_power import HOLD_AT_ONCE
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.recording.period import moment
from bev_preheat.tunables import FAILURE_S, FAULTY
from bev_preheat.vehicle.heater_controller import Refusal

if TYPE_CHECKING:
    from bev_preheat.control.heater_power import HeaterStatus
    from bev_preheat.control.state import State
    from bev_preheat.recording.flight_file import Flight
    from bev_preheat.recording.player import Played
    from bev_preheat_msgs.msg import HvchStatus

# A heater that is asked for less shows nothing [W].
LEAST_W = 50.0
# A smaller deficit is that of measurement.
FULL_FROM = 0.9
NO_HEAT = 0.01
# Heating with shorter breaks is one heating [ns].
LONGEST_BREAK_NS = 600 * NS_PER_S
# In this time of heating a heater fails as probably as it had failed before [ns].
SOON_NS = round(FAULTY * FAILURE_S * NS_PER_S)


class HeaterShares:
    """
    The share (0 ... 1) by the number of the step; `add` takes the steps of the unchanged replay.

    It is the share of `hvch_status`, else the estimated one. A fault that was suspected soon after heating began
    counts from that beginning on, another one from the suspicion on. A heater that is dead or stuck on does not
    follow any command: 0.
    """

    def __init__(self, flight: Flight) -> None:
        """Begin with a heater that delivers its command."""
        self._given = flight.given
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
        return (f'the recorded heater gave {gave} (least share, first deficit seen {moment(weak[0][0])}); the '
                'changed drive counts the shares that the recording shows')

    def _look_at_command(self, number: int) -> None:
        step = self._given[number].step
        if step.command is not None and step.command[0] >= LEAST_W:
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
        answer, estimate = state.heater_answer, state.estimate
        if answer is not None and answer.status is not None and not answer.doubt and not answer.silence:
            self._by_status = True
            return _share_of(answer.status, self._shares[-1])
        self._by_status = False
        if estimate is None:
            return 1.0
        report = estimate.heater
        if report.suspected is not None:
            self._suspected_s = report.suspected.lasts_s
        return {Heater.ANSWERS: 1.0, Heater.DERATED: report.share}.get(report.heater, 0.0)


def _share_of(status: HeaterStatus, before: float) -> float:
    if status.refusal in HOLD_AT_ONCE and status.active_w < LEAST_W:
        return 0.0
    if status.requested_w < LEAST_W or status.refusal is Refusal.RATE_LIMITED:
        return before
    return min(status.confirmed_w / status.requested_w, 1.0)


def alter_status(message: HvchStatus, command_w: float, share: float) -> None:
    """Let an answer of the heater's controller be the one to another command [W], delivered with a share."""
    if message.refusal not in HOLD_AT_ONCE:
        message.active_power = command_w if message.measured_power_known else share * command_w
        if message.refusal == Refusal.NO_COMMAND and command_w > 0.0:
            message.refusal, message.explanation = int(Refusal.NOT_REFUSED), ''
    message.requested_power = command_w
    if message.measured_power_known:
        message.measured_power = share * command_w
