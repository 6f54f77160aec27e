# SPDX-License-Identifier: Apache-2.0
"""The result of each trip of a drive in words: arrived at, short by, why, and the heater's energy."""

from __future__ import annotations

from dataclasses import dataclass, field
import math
from typing import Any, TYPE_CHECKING

from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.messages.diagnostics import heater_sentence
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.status import Status
from bev_preheat.recording.heater_account import HeaterAccount, RECORDED_HOLD_NS, Span
from bev_preheat.recording.heater_share import FULL_FROM

if TYPE_CHECKING:
    from bev_preheat.recording.player import Played

# A smaller deviation from the target is not reported [K]: sensors show whole and half degrees.
LEAST_REPORTED_K = 0.5
# Shorter obstacles explain no deficit [s]; a heater that gives this share of its command is a whole one.
LEAST_OBSTACLE_S = 10.0
LONGEST_STEP_NS = 600 * NS_PER_S


@dataclass
class TripResult:
    """
    A trip from its first plan to its arrival, or to the end of the recording.

    Instants in ns, temperatures in deg C (NaN: unknown). `obstacles` has the time [s] in each status that is one,
    `heater` the sentence on a heater that does not obey ('' for none).
    """

    begun_ns: int
    ended_ns: int
    has_arrived: bool = False
    is_over: bool = False
    temperature_c: float = math.nan
    target_c: float = math.nan
    predicted_c: float = math.nan
    obstacles: dict[Status, float] = field(default_factory=dict)
    heater: str = ''
    account: HeaterAccount = field(default_factory=HeaterAccount)

    def sentences(self) -> list[str]:
        """Return the result in words: arrival with reason, and the heater's energy."""
        return [self._arrival(), self._energy()]

    def _arrival(self) -> str:
        lasted = duration_text((self.ended_ns - self.begun_ns) / NS_PER_S)
        if not self.has_arrived:
            end = 'The trip ended' if self.is_over else 'The recording ends'
            predicted = ('' if math.isnan(self.predicted_c) else
                         f'; the last plan predicted {self.predicted_c:.1f} degC{self._target()}')
            return f'{end} without an arrival after {lasted}{predicted}.'
        if math.isnan(self.temperature_c):
            return f'Arrived after {lasted}; the battery temperature is not known.'
        short_k = self.target_c - self.temperature_c
        arrived = f'Arrived after {lasted} at {self.temperature_c:.1f} degC'
        if math.isnan(short_k):
            return f'{arrived}, without a target.'
        if short_k < -LEAST_REPORTED_K:
            return f'{arrived}, {-short_k:.1f} K above the target of {self.target_c:.1f} degC.'
        if short_k <= LEAST_REPORTED_K:
            return f'{arrived}, target {self.target_c:.1f} degC.'
        return f'{arrived}, {short_k:.1f} K short of the target of {self.target_c:.1f} degC: {self._reason()}.'

    def _target(self) -> str:
        return '' if math.isnan(self.target_c) else f', target {self.target_c:.1f} degC'

    def _reason(self) -> str:
        reasons = [f'{status.meaning.obstacle} for {duration_text(lasted_s)}'
                   for status, lasted_s in sorted(self.obstacles.items(), key=lambda item: -item[1])
                   if lasted_s >= LEAST_OBSTACLE_S]
        commanded_wh, delivered_wh = self.account.commanded_wh, self.account.delivered_wh
        lapsed_s = sum(span.length_s for span in self.account.without_command)
        if lapsed_s >= LEAST_OBSTACLE_S:
            reasons.append(f'the heater had no valid command for {duration_text(lapsed_s)}')
        if self.heater:
            reasons.append(self.heater)
        elif commanded_wh is not None and delivered_wh is not None and delivered_wh < FULL_FROM * commanded_wh:
            reasons.append(f'the heater delivered {delivered_wh:.0f} Wh of the {commanded_wh:.0f} Wh that were '
                           'commanded')
        if reasons:
            return '; '.join(reasons)
        return ('the recording names no obstacle' if math.isnan(self.predicted_c) else
                f'the recording names no obstacle; the last plan predicted {self.predicted_c:.1f} degC')

    def _energy(self) -> str:
        commanded_wh, delivered_wh = self.account.commanded_wh, self.account.delivered_wh
        return f'The heater was commanded {commanded_wh or 0.0:.0f} Wh' + (
            '; the delivered energy is not recorded (hvch_status).' if delivered_wh is None else
            f' and delivered {delivered_wh:.0f} Wh.')


class TripResults:
    """The HeaterAccount of a drive and the TripResults of its trips, filled by `add`."""

    def __init__(self) -> None:
        """Start without a trip."""
        self.account = HeaterAccount()
        self.trips: list[TripResult] = []
        self._latest_ns = 0

    def add(self, played: Played, recorded_w: float | None = None) -> None:
        """
        Add a step.

        `recorded_w` [W] is the heater's recorded power if no planner commanded it, None: one did.
        """
        now_ns, state = played.now_ns, played.state
        trip = self._trip_of(played)
        for account in [self.account, *([] if trip is None else [trip.account])]:
            if recorded_w is not None:
                account.deliver(now_ns, recorded_w, now_ns + RECORDED_HOLD_NS)
                continue
            if state.latest_command is not None:
                account.command(now_ns, state.latest_command.battery_heating_power_w,
                                state.latest_command.valid_until_ns)
            if state.heater_answer is not None and state.heater_answer.status is not None:
                account.answer(state.heater_answer.status)
        if trip is not None:
            self._note(trip, played)
        self._latest_ns = now_ns

    def _trip_of(self, played: Played) -> TripResult | None:
        decision = played.state.decision
        current = self.trips[-1] if self.trips and not self.trips[-1].is_over else None
        if current is None and decision.plan is not None and not decision.status.meaning.is_over:
            current = TripResult(played.now_ns, played.now_ns)
            self.trips.append(current)
            # An obstacle until now belongs to no trip.
            self._latest_ns = played.now_ns
        return current

    def _note(self, trip: TripResult, played: Played) -> None:
        state, decision = played.state, played.state.decision
        status, plan = decision.status, decision.plan
        trip.ended_ns = played.now_ns
        if status.meaning.obstacle:
            lasted_ns = min(max(played.now_ns - self._latest_ns, 0), LONGEST_STEP_NS)
            trip.obstacles[status] = trip.obstacles.get(status, 0.0) + lasted_ns / NS_PER_S
        if state.measurement is not None:
            trip.temperature_c = state.measurement.state.temperature_c
        if plan is not None and not status.meaning.is_over:
            trip.target_c, trip.predicted_c = plan.target_temperature_c, plan.arrival_temperature_c
        if state.estimate is not None and state.estimate.heater.heater is not Heater.ANSWERS:
            trip.heater = f'heater {heater_sentence(state.estimate.heater).partition(";")[0]}'
        trip.has_arrived = status.meaning.is_over
        trip.is_over = trip.has_arrived or status is Status.NO_ROUTE


def lapses_in_words(spans: list[Span]) -> str:
    """Return the number and the length of the spans without a valid command; '' for none."""
    if not spans:
        return ''
    lasted = duration_text(sum(span.length_s for span in spans))
    return f'{len(spans)} span{"" if len(spans) == 1 else "s"}, {lasted} in all'


def span_values(spans: list[Span]) -> list[dict[str, Any]]:
    """Return Spans as plain values for JSON."""
    return [span._asdict() for span in spans]
