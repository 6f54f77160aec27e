# SPDX-License-Identifier: Apache-2.0
"""All messages of one planner: latest values, history of the drive of bounded size, changes of the plan."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
import math
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.control.heater import HeaterStatus
from bev_preheat.errors import shortened
from bev_preheat.monitoring.seen import diagnose, Diagnosis, LONGEST_SOURCE, MOST_ENTRIES, PlanSeen, RouteSeen
from bev_preheat.monitoring.view import (
    Banner,
    banner_of,
    instant,
    instants,
    LONGEST_SENTENCE,
    number,
    numbers,
    Pulse,
    status_name,
    Surroundings,
)
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.recording.battery_response import Unheated
from bev_preheat.recording.heater_account import ANSWER_HOLDS_NS, HeaterAccount
from bev_preheat.vehicle.description import HVCH

if TYPE_CHECKING:
    from diagnostic_msgs.msg import DiagnosticStatus

TRAIL_POINTS = 2000
# Points older than this are dropped [s].
HORIZON_S = 86400.0
# Rows of a full trail are at least this share of their age apart, divided by the most rows, and this time [s].
# Then some 3/4 of the rows are left, whatever the rate: their number grows with the logarithm of the horizon.
SHARE_OF_AGE, LEAST_APART_S = 14.0, 0.05
MOST_MARKS, MOST_SPANS = 200, 200
NO_COMMAND = 'no valid command'
# The trajectories of a plan are drawn with at most so many points.
MOST_PLAN_POINTS = 240
# A stamp earlier than its topic's latest by more than this [s] belongs to another drive.
BACK_S = 1.0
# Smaller changes of a plan are the usual re-planning: start of heating [s], target and prediction [K].
START_CHANGE_S, TARGET_CHANGE_K, PREDICTION_CHANGE_K = 60.0, 0.5, 1.0
# A power that changes by less is the same [W].
LEAST_CHANGE_W = 5.0
# The planner makes a plan at each battery state; an older one says nothing about the battery of now [s].
PLAN_FRESH_S = 10.0
ANSWER_HOLDS_S = ANSWER_HOLDS_NS / NS_PER_S
# A heater's controller refuses longer leases [s].
LONGEST_LEASE_S = 60.0
# The range of the stamps of messages [s].
MOST_STAMP_S = 2.0**31


class Trail:
    """
    Rows of numbers, the instant [s] first, in order of time; at most `most` rows.

    A full trail drops the rows beyond the horizon, and others so that older rows are further apart. `generation`
    changes when rows were dropped, so that a reader knows that it has to read all rows again.
    """

    def __init__(self, most: int = TRAIL_POINTS, horizon_s: float = HORIZON_S) -> None:
        self._most, self._horizon_s = most, horizon_s
        self._rows: list[tuple[float, ...]] = []
        self.generation = 0

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._rows)

    def add(self, row: tuple[float, ...]) -> None:
        """Add a row; one with the latest instant, or with an earlier one, replaces the later rows."""
        if self._rows and row[0] <= self._rows[-1][0]:
            self.generation += 1
        while self._rows and row[0] <= self._rows[-1][0]:
            self._rows.pop()
        self._rows.append(row)
        if len(self._rows) > self._most:
            self._thin(row[0])

    def since(self, count: int) -> Sequence[tuple[float, ...]]:
        """Return the rows after the first `count`."""
        return self._rows[count:]

    def _thin(self, now_s: float) -> None:
        share, kept, later_s = SHARE_OF_AGE / self._most, [self._rows[-1]], self._rows[-1][0]
        for row in reversed(self._rows[:-1]):
            age_s = now_s - row[0]
            if age_s > self._horizon_s:
                break
            if later_s - row[0] >= max(share * age_s, LEAST_APART_S):
                kept.append(row)
                later_s = row[0]
        self._rows = kept[::-1][-self._most:]
        self.generation += 1


class Mark(NamedTuple):
    """A change of the plan at an instant [s]: its status, a sentence, a few words for the curves ('' for none)."""

    at_s: float
    status: str
    text: str
    label: str = ''


class Span(NamedTuple):
    """A period [s] with a text, such as a regime; `to_s` None: it lasts."""

    from_s: float
    to_s: float | None
    text: str


class Board:
    """
    The state of one planner, as the page shows it; instants in seconds of its clock, `now_s` monotonic.

    Temperatures in deg C, powers in W, charge 0 ... 1; None and NaN stand for unknown. `until_s` is the end of the
    latest command's lease, `sources_w` the commands to all heat sources by name, {} for the HVCH alone. `unheated`
    computes the temperature without heating; None: not known for this vehicle, with `unheated_problem` as the
    reason. `outcome` says how the latest goal of the page ended.
    """

    def __init__(self) -> None:
        self.unheated: Unheated | None = None
        self.unheated_problem = ''
        self.around = Surroundings()
        self._route: RouteSeen | None = None
        self.forget()

    def forget(self) -> None:
        """Start another drive: drop values and history."""
        self.temperatures, self.powers, self.deliveries, self.mixes = Trail(), Trail(), Trail(), Trail()
        # Powers [W] of the heat sources by name, the HVCH first: latest row of `mixes`, and next.
        self.sources_w, self._coming_w = dict[str, float](), dict[str, float]()
        self._coming_s = -math.inf
        self._account = HeaterAccount()
        # Instant [s] and power [W] of the heater's latest answer.
        self._delivered = (-math.inf, math.nan)
        self.until_s = math.inf
        self.marks: deque[Mark] = deque(maxlen=MOST_MARKS)
        self.regimes: deque[Span] = deque(maxlen=MOST_SPANS)
        self.doubts: deque[Span] = deque(maxlen=MOST_SPANS)
        self.plan: PlanSeen | None = None
        self.trip_from_s: float | None = None
        self._marked: PlanSeen | None = None
        self.temperature_c = self.soc = self.power_w = math.nan
        self.reason: int | None = None
        self.diagnosis = Diagnosis()
        # The planner's time; None before its first message.
        self.at_s: float | None = None
        self.outcome = ''
        self._latest_s: dict[str, float] = {}
        self.pulses = {topic: Pulse() for topic in ('battery', 'command', 'plan', 'diagnostics')}
        self.generation = getattr(self, 'generation', 0) + 1
        if self.unheated is not None:
            self.unheated.restart()

    # Values come in

    def see_battery(self, at_s: float, temperature_c: float, soc: float, now_s: float) -> None:
        """Take a battery state."""
        self._advance('battery', at_s, now_s)
        self.temperature_c, self.soc, plan = temperature_c, soc, self.plan
        # With the heat under way, as far as a fresh plan tells it.
        settled_c = (plan.temperatures_c[0] if plan is not None and plan.times_s
                     and abs(at_s - plan.at_s) < PLAN_FRESH_S else math.nan)
        unheated_c = math.nan if self.unheated is None else self.unheated.unheated_c(
            at_s, settled_c, soc, *self._drawn_w(at_s, settled_c, {
                HVCH: self._heat_w(at_s), **(self._coming_w if at_s <= self.until_s else {})}))
        self.temperatures.add((at_s, temperature_c, soc, unheated_c))

    def see_command(self, at_s: float, power_w: float, reason: int, now_s: float,
                    until_s: float = math.inf) -> None:
        """Take a heater command with the end of its lease [s]."""
        self._advance('command', at_s, now_s)
        if math.isfinite(power_w) and not abs(power_w - self.power_w) < LEAST_CHANGE_W:
            self.powers.add((at_s, power_w))
        self.power_w, self.reason, self.until_s = power_w, reason, until_s
        if math.isfinite(power_w):
            self._account.command(_ns(at_s), power_w, _ns(min(until_s, at_s + LONGEST_LEASE_S)))

    def see_source(self, at_s: float, name: str, power_w: float) -> None:
        """Take a command to another heat source; those of an instant are shown once the next instant's begin."""
        if self.at_s is None or not abs(at_s - self.at_s) <= LONGEST_LEASE_S or at_s < self._coming_s:
            return
        name, before_w = shortened(name, LONGEST_SOURCE), self.sources_w
        if at_s > self._coming_s:
            # That of the HVCH comes last.
            mix_w = {HVCH: self.power_w, **self._coming_w}
            if len(mix_w) > len(before_w):
                # Rows with more columns.
                self.mixes, self.generation = Trail(), self.generation + 1
            if self._coming_w and not all(abs(watts - before_w.get(each, math.nan)) < LEAST_CHANGE_W
                                          for each, watts in mix_w.items()):
                self.mixes.add((self._coming_s, *mix_w.values()))
                self.sources_w = mix_w
            self._coming_s, self._coming_w = at_s, dict(self._coming_w)
        if math.isfinite(power_w) and name != HVCH and (
                name in self._coming_w or len(self._coming_w) < MOST_ENTRIES):
            self._coming_w[name] = power_w

    def see_answer(self, status: HeaterStatus) -> None:
        """Take an answer of the heater's controller."""
        at_s, power_w = status.stamp_ns / NS_PER_S, status.confirmed_w
        before_s, before_w = self._delivered
        if at_s <= before_s:
            return
        if before_s + ANSWER_HOLDS_S < at_s and not math.isnan(before_w):
            self.deliveries.add((before_s + ANSWER_HOLDS_S, math.nan))
            before_w = math.nan
        if not abs(power_w - before_w) < LEAST_CHANGE_W:
            self.deliveries.add((at_s, power_w))
        self._delivered = at_s, power_w
        self._account.answer(status)

    def delivered_w(self, at_s: float | None) -> float:
        """Return the delivered power [W] at an instant [s]; NaN: no recent answer."""
        answered_s, power_w = self._delivered
        return power_w if at_s is not None and at_s - answered_s <= ANSWER_HOLDS_S else math.nan

    def _heat_w(self, at_s: float) -> float:
        """Return the heater's power [W] as delivered, else the estimated share of the command."""
        delivered_w = self.delivered_w(at_s)
        if not math.isnan(delivered_w):
            return delivered_w
        return self.diagnosis.heater_share * self.power_w if at_s <= self.until_s else 0.0

    def _drawn_w(self, at_s: float, temperature_c: float,
                 powers_w: Mapping[str, float]) -> tuple[float, float | None]:
        """Return power and heat as HVCH power [W] of sources by name; None: that of the HVCH alone, or unknown."""
        ambient_c = math.nan if self._route is None else self._route.ambient_at_c(at_s)
        if self.unheated is None or self.unheated.sources is None or math.isnan(ambient_c):
            return powers_w[HVCH], None
        return self.unheated.sources.of(powers_w, ambient_c, temperature_c)

    def see_plan(self, plan: PlanSeen, now_s: float) -> None:
        """Take a plan."""
        self._advance('plan', plan.at_s, now_s)
        if self.plan is None or plan.message.route_id != self.plan.message.route_id:
            self.trip_from_s = plan.at_s
        self.plan = plan
        mark = change_of(self._marked, plan)
        if mark is not None:
            self.marks.append(mark)
            self._marked = plan

    def see_route(self, route: RouteSeen) -> None:
        """Take a route."""
        self._route = route

    def see_diagnostics(self, at_s: float, entries: Mapping[str, DiagnosticStatus], now_s: float) -> None:
        """Take the planner's entries of /diagnostics by part."""
        self._advance('diagnostics', at_s, now_s)
        self.diagnosis = diagnose(entries)
        _note(self.regimes, at_s, self.diagnosis.regime)
        _note(self.doubts, at_s, ', '.join(self.diagnosis.doubts))

    def _advance(self, topic: str, at_s: float, now_s: float) -> None:
        """Note that a message came; start again if its clock was set back."""
        if at_s < self._latest_s.get(topic, -math.inf) - BACK_S:
            self.forget()
        self._latest_s[topic] = at_s
        self.at_s = at_s if self.at_s is None else max(self.at_s, at_s)
        self.pulses[topic].beat(now_s, at_s)

    # Values for the page

    def banner(self, now_s: float) -> Banner | None:
        """Return the Banner on a missing, silent or frozen planner; None if all is well."""
        return banner_of(self.around, self.pulses['command'], self.pulses['battery'], now_s)

    def late(self, now_s: float) -> list[str]:
        """Return the overdue topics."""
        return sorted(topic for topic, pulse in self.pulses.items()
                      if pulse.is_late(now_s) or not self.around.is_there)

    @property
    def reserve(self) -> float | None:
        """The charge asked for on arrival; None: none, or unknown."""
        if self._route is None or self.plan is None:
            return None
        return self._route.reserve_of_leg(len(self.plan.message.later_arrival)) or None

    def plan_curves(self) -> dict[str, Any]:
        """Return the trajectories of the plan, thinned; empty columns without one."""
        plan = self.plan
        if plan is None or not plan.times_s:
            return {'planMix': {}, **{key: [] for key in (
                'planTime', 'planned', 'planUnheated', 'planSoc', 'planPower')}}
        unheated_c = [] if self.unheated is None else self.unheated.planned_c(
            plan.times_s, plan.temperatures_c, plan.socs, [
                self._drawn_w(at_s, plan.temperatures_c[step], {
                    HVCH: plan.powers_w[step], **{name: each_w[step] for name, each_w in plan.sources_w.items()}})
                for step, at_s in enumerate(plan.times_s[:-1])])
        kept = thinned(len(plan.times_s), MOST_PLAN_POINTS)
        powers_w = (*plan.powers_w, math.nan)

        def column(values: Sequence[float], digits: int) -> list[float | None]:
            return [number(values[index], digits) if index < len(values) else None for index in kept]

        return {'planMix': {name: column(each_w, 0) for name, each_w in plan.sources_w.items()},
                'planTime': instants([plan.times_s[index] for index in kept]),
                'planned': column(plan.temperatures_c, 2),
                'planUnheated': column(unheated_c, 2), 'planSoc': column(plan.socs, 4),
                'planPower': column(powers_w, 0)}

    def history(self, temperatures: int = 0, powers: int = 0, deliveries: int = 0,
                mixes: int = 0) -> dict[str, Any]:
        """Return the history after the first rows of each trail, in columns."""
        mix_rows = self.mixes.since(mixes)
        values: dict[str, Any] = {'mixTime': instants([row[0] for row in mix_rows]),
                                  'mix': [numbers(row[1:], 0) for row in mix_rows]}
        # The columns of each trail with their digits.
        for trail, count, time, columns in (
                (self.temperatures, temperatures, 'time', {'measured': 2, 'soc': 4, 'unheated': 2}),
                (self.powers, powers, 'powerTime', {'power': 0}),
                (self.deliveries, deliveries, 'deliveredTime', {'delivered': 0})):
            rows = trail.since(count)
            values[time] = instants([row[0] for row in rows])
            values |= {name: numbers([row[at] for row in rows], digits)
                       for at, (name, digits) in enumerate(columns.items(), start=1)}
        return values

    def events(self) -> dict[str, Any]:
        """Return what changed in the plan, the periods of regimes and doubts, and lapses of the command."""
        lapses = [Span(span.from_ns / NS_PER_S, span.to_ns / NS_PER_S, NO_COMMAND)
                  for span in self._account.latest_without_command(MOST_SPANS)]
        if self.at_s is not None and self.at_s > self.until_s:
            lapses.append(Span(self.until_s, None, NO_COMMAND))
        return {'marks': [[instant(mark.at_s), *mark[1:]] for mark in self.marks],
                'regimes': [list(span) for span in self.regimes if span.text],
                'doubts': [list(span) for span in self.doubts if span.text],
                'lapses': [list(span) for span in lapses]}


def thinned(count: int, most: int) -> list[int]:
    """Return at most `most` evenly spread indices of `count` points, the last one included."""
    if count <= most:
        return list(range(count))
    return sorted({round(index * (count - 1) / (most - 1)) for index in range(most)})


def change_of(before: PlanSeen | None, plan: PlanSeen) -> Mark | None:
    """Return the Mark of a plan that differs from an earlier one; None if nothing of note changed."""
    said = plan.message

    def mark(text: str, label: str = '') -> Mark:
        return Mark(plan.at_s, status_name(said.status), text, label)

    if before is None or (before.message.status, before.message.route_id) != (said.status, said.route_id):
        return mark(shortened(said.explanation, LONGEST_SENTENCE))
    earlier = before.message
    target_c, before_c = said.target_battery_temperature, earlier.target_battery_temperature
    if abs(target_c - before_c) >= TARGET_CHANGE_K:
        return mark(f'Target {target_c:.1f} instead of {before_c:.1f} degC.', f'target {target_c:.1f} degC')
    start_s, before_s = plan.heating_start_s, before.heating_start_s
    # The start of heating that is under way is the instant of the plan.
    if start_s is not None and before_s is not None and start_s > plan.at_s and (
            abs(start_s - before_s) >= START_CHANGE_S):
        shift = f'{duration_text(abs(start_s - before_s))} {"later" if start_s > before_s else "earlier"}'
        return mark(f'Heating starts {shift} than planned before.', f'starts {shift}')
    arrival_c, before_c = said.predicted_arrival_temperature, earlier.predicted_arrival_temperature
    if abs(arrival_c - before_c) >= PREDICTION_CHANGE_K:
        return mark(f'Arrival at {arrival_c:.1f} instead of {before_c:.1f} degC.', f'arrival {arrival_c:.1f} degC')
    return None


def _note(spans: deque[Span], at_s: float, text: str) -> None:
    """Begin a new span if the text changes, and end the one before."""
    if spans and spans[-1].text == text:
        return
    if spans:
        spans[-1] = spans[-1]._replace(to_s=at_s)
    spans.append(Span(at_s, None, text))


def _ns(at_s: float) -> int:
    return round(min(max(at_s, -MOST_STAMP_S), MOST_STAMP_S) * NS_PER_S)
