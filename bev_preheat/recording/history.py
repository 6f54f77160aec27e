# SPDX-License-Identifier: Apache-2.0
"""The contents of a report: columns over time; plans, sentences and diagnostics at their changes."""

from __future__ import annotations

from array import array
import math
import re
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.messages.diagnostics import planner_diagnostics
from bev_preheat.numerics import NS_PER_S
from bev_preheat.recording.battery_response import Unheated
from bev_preheat.recording.course import LEAST_HEAT_W
from bev_preheat.vehicle.description import HVCH

if TYPE_CHECKING:
    from bev_preheat.control.decision import Decision
    from bev_preheat.control.inputs import Leg
    from bev_preheat.control.state import State
    from bev_preheat.recording.replay import Played

# Rows of a drive of any length; a day has one a second.
MOST_ROWS = 90_000
LEAST_PERIOD_NS = NS_PER_S
# A plan is kept if start or arrival [s], or a temperature [K], moved by more since the latest kept plan.
PLAN_SHIFT_S, PLAN_SHIFT_K = 60.0, 0.5
MOST_PLANS, HISTORY_PLAN_POINTS = 400, 120
MOST_CHANGES = 3000
# The clock has jumped if it went back, or on by more [ns].
CLOCK_JUMP_NS = 86400 * NS_PER_S
COLUMNS = ('time', 'measured', 'estimated', 'estimated_low', 'estimated_high', 'predicted', 'predicted_low',
           'predicted_high', 'target', 'most', 'ambient', 'commanded', 'confirmed', 'soc', 'power', 'unheated')
# Numbers in a sentence change from step to step; only other words make it another one.
NUMBER = re.compile(r'[0-9.+-]+')


class Change(NamedTuple):
    """Values that hold from an instant [ns] on."""

    now_ns: int
    values: tuple[str, ...]


class KeptPlan(NamedTuple):
    """
    A plan as it was made at an instant [ns], thinned.

    `label` describes it. `time_s` since 1970 [s], `temperature_c` and `soc` of shape (N,), and
    `power_w` [W] of shape (N,), the last one 0.
    """

    now_ns: int
    label: str
    time_s: list[float]
    temperature_c: list[float]
    soc: list[float]
    power_w: list[float]


class History:
    """
    Collects a drive step by step; `add` takes each Played.

    `columns` has the values of COLUMNS, NaN for unknown: times in s since 1970, temperatures in deg C, powers in
    W, charge 0 ... 1. `sources` has the commanded power of each of several heat sources by name, {} for the HVCH
    alone. `sentences` (status, sentence), `regimes` (regime,), `doubts` (names of signals,) and
    `diagnostics` (entry, level, message) are Changes; `lost` counts the changes beyond MOST_CHANGES, `jumps` those
    of the clock, after which times are those of the clock before.
    """

    def __init__(self, length_ns: int) -> None:
        """Prepare for a drive of a length [ns]."""
        self._period_ns = max(LEAST_PERIOD_NS, length_ns // MOST_ROWS)
        self._due_ns = self._latest_ns = -1
        self._latest: tuple[Any, ...] = ()
        self.columns: dict[str, array[float]] = {name: array('d') for name in COLUMNS}
        self.sources: dict[str, array[float]] = {}
        self.sentences: list[Change] = []
        self.regimes: list[Change] = []
        self.doubts: list[Change] = []
        self.diagnostics: list[Change] = []
        self.plans: list[KeptPlan] = []
        self.lost = self.jumps = 0
        # By how much the drawn time is ahead of the clock.
        self._ahead_ns = 0
        self._known: dict[str, object] = {}
        # Status, start and arrival [s], temperatures on arrival and of the target [deg C] of the latest kept plan.
        self._plan_key: tuple[float, ...] | None = None
        self._unheated: Unheated | None = None

    def add(self, played: Played) -> None:
        """Add a step."""
        now_ns, state, recorded_w = self._drawn_ns(played.now_ns), played.state, played.recorded_w
        command, decision = state.latest_command, state.decision
        if command is not None and command.valid_until_ns < played.now_ns:
            command = None
        power_w = recorded_w if recorded_w is not None else 0.0 if command is None else command.total_w
        switched = (decision.status, power_w >= LEAST_HEAT_W)
        if now_ns < self._due_ns and switched == self._latest:
            return
        self._due_ns = now_ns - now_ns % self._period_ns + self._period_ns
        self._latest, self._latest_ns = switched, now_ns
        self._add_row(now_ns, state, power_w, recorded_w is None)
        if not self.sources and state.vehicle.heat_sources:
            # The first row is that of the vehicle whose sources are shown.
            none = array('d', [0.0] * (len(self.columns['time']) - 1))
            self.sources = {name: none[:] for name in (HVCH, *(each.name for each in state.vehicle.heat_sources))}
        for name, powers_w in self.sources.items():
            powers_w.append(0.0 if command is None else command.power_w(name))
        if recorded_w is not None:
            return
        explanation = decision.explanation
        self._note('sentence', self.sentences, now_ns, (decision.status.name, explanation),
                   (decision.status, NUMBER.sub('', explanation)))
        self._note('regime', self.regimes, now_ns, (state.regime.regime.value,))
        self._note('doubts', self.doubts, now_ns, tuple(verdict.signal for verdict in state.signal_verdicts))
        self._add_diagnostics(now_ns, played)
        self._add_plan(now_ns, decision)

    def _drawn_ns(self, now_ns: int) -> int:
        """Return the instant [ns] at which a step is drawn: curves go forwards, whatever the clock does."""
        if self._latest_ns < 0:
            return now_ns
        for ahead_ns in (0, self._ahead_ns):
            if 0 <= now_ns + ahead_ns - self._latest_ns <= CLOCK_JUMP_NS:
                self._ahead_ns = ahead_ns
                return now_ns + ahead_ns
        self.jumps += 1
        self._ahead_ns = self._latest_ns - now_ns
        return self._latest_ns

    def _add_row(self, now_ns: int, state: State, command_w: float, has_planner: bool) -> None:
        decision, measurement, at_ns = state.decision, state.measurement, now_ns - self._ahead_ns
        estimate, plan = (state.estimate, decision.plan) if has_planner else (None, None)
        row = dict.fromkeys(COLUMNS, math.nan)
        row |= {'time': now_ns / NS_PER_S, 'ambient': _ambient_c(decision.leg, at_ns), 'commanded': command_w}
        if measurement is not None:
            row |= {'measured': measurement.state.temperature_c, 'soc': measurement.state.soc}
            if measurement.power_w is not None:
                row['power'] = measurement.power_w
        if estimate is not None:
            row |= _band('estimated', estimate.temperature_c, estimate.temperature_deviation_k)
        if plan is not None:
            row |= _band('predicted', plan.arrival_temperature_c, decision.arrival_deviation_k)
            row['target'] = plan.target_temperature_c
            if math.isfinite(plan.maximum_arrival_temperature_c):
                row['most'] = plan.maximum_arrival_temperature_c
        heater_w, heat_w = command_w if estimate is None else estimate.heater.share * command_w, None
        answer = state.answers.hvch.status
        if answer is not None and not state.vehicle.heat_sources:
            row['confirmed'] = heater_w = answer.confirmed_w
        if state.vehicle.heat_sources and has_planner and state.temperature_c is not None:
            powers = state.answers.powers(
                state.vehicle, state.temperature_c, {} if estimate is None else state.learning.shares)
            hvch_w, drawn_w, source_heat_w = powers.others_w(
                -1, at_ns, at_ns, powers.temperature_c if math.isnan(row['ambient']) else row['ambient'],
                [state.vehicle.most_w(each.name) for each in state.answers.of_all])
            heater_w, heat_w = hvch_w + drawn_w, hvch_w + source_heat_w
        if self._unheated is None:
            self._unheated = Unheated(state.vehicle)
        settled_c = math.nan if plan is None else float(plan.battery_temperature_c[0])
        row['unheated'] = self._unheated.unheated_c(row['time'], settled_c, row['soc'], heater_w, heat_w)
        for name, value in row.items():
            self.columns[name].append(value)

    def _add_diagnostics(self, now_ns: int, played: Played) -> None:
        for entry in planner_diagnostics(played.state, played.now_ns):
            name = entry.name
            # `preheating` repeats status and sentence.
            level = int.from_bytes(entry.level)
            if name != 'preheating' or level:
                self._note(f'diagnostics {name}', self.diagnostics, now_ns, (name, str(level), entry.message),
                           (level, NUMBER.sub('', entry.message)))
            elif self._known.get('diagnostics preheating', (0,)) != (0,):
                self._note('diagnostics preheating', self.diagnostics, now_ns, (name, '0', entry.message), (0,))

    def _note(self, kind: str, changes: list[Change], now_ns: int, values: tuple[str, ...],
              key: object = None) -> None:
        key = values if key is None else key
        if self._known.get(kind) == key:
            return
        self._known[kind] = key
        if len(changes) < MOST_CHANGES:
            changes.append(Change(now_ns, values))
        else:
            self.lost += 1

    def _add_plan(self, now_ns: int, decision: Decision) -> None:
        plan = decision.plan
        if plan is None or len(plan.time_s) < 2:
            self._plan_key = None
            return
        start_s = (decision.plan_start_ns + self._ahead_ns) / NS_PER_S
        begins_s = math.inf if plan.heating_start_s is None else start_s + plan.heating_start_s
        key = (int(decision.status), begins_s, start_s + plan.arrival_time_s, plan.arrival_temperature_c,
               plan.target_temperature_c)
        # While heating, each plan starts with heat.
        is_under_way = plan.heating_start_s is not None and plan.heating_start_s <= 0.0
        shifts = (0.0, math.inf if is_under_way else PLAN_SHIFT_S, PLAN_SHIFT_S, PLAN_SHIFT_K, PLAN_SHIFT_K)
        # The difference of two plans without heating is NaN, which exceeds nothing.
        if self._plan_key is not None and not any(
                abs(after - before) > shift for before, after, shift in zip(self._plan_key, key, shifts)):
            return
        self._plan_key = key
        if len(self.plans) >= MOST_PLANS:
            # Every other one makes room for later ones.
            del self.plans[1::2]
        chosen = range(0, len(plan.time_s), -(-len(plan.time_s) // HISTORY_PLAN_POINTS))
        indices = [*chosen, *([] if chosen[-1] == len(plan.time_s) - 1 else [len(plan.time_s) - 1])]
        of_all = plan.source_power_w or {HVCH: plan.hvch_battery_power_w}
        powers = [*map(sum, zip(*(power_w.tolist() for power_w in of_all.values()))), 0.0]
        begins = ('no heating' if plan.heating_start_s is None else 'heating now' if is_under_way
                  else f'heating in {plan.heating_start_s / 60.0:.1f} min')
        self.plans.append(KeptPlan(
            now_ns, f'{decision.status.name}: {begins}, {plan.arrival_temperature_c:.1f} degC on arrival',
            (start_s + plan.time_s[indices]).tolist(), plan.battery_temperature_c[indices].tolist(),
            plan.soc[indices].tolist(),
            # The mean power from each kept instant to the next.
            [*(sum(powers[low:high]) / (high - low) for low, high in zip(indices, indices[1:])), 0.0]))


def _band(name: str, value: float, deviation: float) -> dict[str, float]:
    return {name: value, f'{name}_low': value - deviation, f'{name}_high': value + deviation}


def _ambient_c(leg: Leg | None, now_ns: int) -> float:
    """Return the ambient temperature that the route gives for an instant [deg C]; NaN outside of the leg."""
    if leg is None or not 0.0 <= (elapsed_s := (now_ns - leg.start_ns) / NS_PER_S) < leg.route.time_s[-1]:
        return math.nan
    return float(leg.route.ambient_temperature_c[leg.route.segment_at(elapsed_s)])
