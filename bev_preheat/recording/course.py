# SPDX-License-Identifier: Apache-2.0
"""A drive as recorded or replayed: instants, the figures of `preheat replay`, the result of each trip as text."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
import math
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.control.heater import HEATER_STATUS, SOURCE_STATUS
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.messages.diagnostics import heater_sentence
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.status import Status
from bev_preheat.recording.changes import changes_in_words
from bev_preheat.recording.flight import Period
from bev_preheat.recording.heater_account import FULL_FROM, HeaterAccount, RECORDED_HOLD_NS
from bev_preheat.vehicle.description import HVCH

if TYPE_CHECKING:
    from bev_preheat.recording.changes import Changes
    from bev_preheat.recording.replay import Played

# A smaller deviation from the target is not reported [K]: sensors show whole and half degrees.
LEAST_REPORTED_K = 0.5
# Shorter obstacles explain no deficit [s]; a heater that gives this share of its command is a whole one.
LEAST_OBSTACLE_S = 10.0
LONGEST_STEP_NS = 600 * NS_PER_S
# Heater power below this is off [W].
LEAST_HEAT_W = 1.0
# Two starts that differ by less are the same [s].
SAME_START_S = 1.0


@dataclass
class TripResult:
    """
    A trip from its first plan to its arrival, or to the end of the recording.

    Instants in ns, temperatures in deg C (NaN: unknown); the battery may arrive at `most_c`. `obstacles` has the
    time [s] in each status that is one, `heater` the sentence on a heater that does not obey ('' for none),
    `accounts` the HeaterAccount of each heat source by name.
    """

    begun_ns: int
    ended_ns: int
    has_arrived: bool = False
    is_over: bool = False
    temperature_c: float = math.nan
    target_c: float = math.nan
    most_c: float = math.inf
    predicted_c: float = math.nan
    obstacles: dict[Status, float] = field(default_factory=dict)
    heater: str = ''
    accounts: defaultdict[str, HeaterAccount] = field(default_factory=lambda: defaultdict(HeaterAccount))

    def sentences(self) -> list[str]:
        """Return the result as text: arrival with reason, and the heater's energy."""
        return [self._arrival(), *(_energy(*each) for each in self.accounts.items())]

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
        hot_k = self.temperature_c - self.most_c
        if hot_k > LEAST_REPORTED_K:
            return f'{arrived}, {hot_k:.1f} K above the {self.most_c:.1f} degC allowed: {self._reason()}.'
        if math.isfinite(self.most_c) and short_k <= LEAST_REPORTED_K:
            return f'{arrived}, allowed {self.target_c:.1f} … {self.most_c:.1f} degC.'
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
        lapsed_s = sum(span.length_s for span in self.accounts[HVCH].without_command)
        if lapsed_s >= LEAST_OBSTACLE_S:
            reasons.append(f'the heater had no valid command for {duration_text(lapsed_s)}')
        if self.heater:
            reasons.append(self.heater)
        else:
            reasons += [f'{_named(name)} delivered {account.delivered_wh:.0f} Wh of the '
                        f'{account.commanded_wh:.0f} Wh that were commanded'
                        for name, account in self.accounts.items()
                        if account.commanded_wh is not None and account.delivered_wh is not None
                        and account.delivered_wh < FULL_FROM * account.commanded_wh]
        if reasons:
            return '; '.join(reasons)
        return ('the recording names no obstacle' if math.isnan(self.predicted_c) else
                f'the recording names no obstacle; the last plan predicted {self.predicted_c:.1f} degC')


def _energy(name: str, account: HeaterAccount) -> str:
    subject = _named(name)
    return f'{subject[0].upper()}{subject[1:]} was commanded {account.commanded_wh or 0.0:.0f} Wh' + (
        f'; the delivered energy is not recorded ({HEATER_STATUS if name == HVCH else SOURCE_STATUS}).'
        if account.delivered_wh is None else f' and delivered {account.delivered_wh:.0f} Wh.')


def _named(name: str) -> str:
    return f'the {"heater" if name == HVCH else name}'


class TripResults:
    """The HeaterAccount of each heat source of a drive, by name, and the TripResults of its trips."""

    def __init__(self) -> None:
        self.accounts: defaultdict[str, HeaterAccount] = defaultdict(HeaterAccount)
        self.trips: list[TripResult] = []
        self._latest_ns = 0

    @property
    def account(self) -> HeaterAccount:
        """That of the HVCH."""
        return self.accounts[HVCH]

    @property
    def energies_wh(self) -> dict[str, float | None]:
        """The commanded and the delivered energy of each heat source [Wh]; None: not recorded."""
        return {f'{name}_{what}_wh': energy_wh for name, account in self.accounts.items()
                for what, energy_wh in (('commanded', account.commanded_wh), ('delivered', account.delivered_wh))}

    def add(self, played: Played) -> None:
        """Add a step."""
        now_ns, state, recorded_w = played.now_ns, played.state, played.recorded_w
        trip = self._trip_of(played)
        command, answers = state.latest_command, {each.name: each.status for each in state.answers.of_all}
        for accounts in [self.accounts, *([] if trip is None else [trip.accounts])]:
            if recorded_w is not None:
                accounts[HVCH].deliver(now_ns, recorded_w, now_ns + RECORDED_HOLD_NS)
                continue
            for name in (HVCH, *(source.name for source in state.vehicle.heat_sources)):
                account, answer = accounts[name], answers.get(name)
                if command is not None:
                    account.command(now_ns, command.power_w(name), command.valid_until_ns)
                if answer is not None:
                    account.answer(answer)
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
            trip.most_c = plan.maximum_arrival_temperature_c
        if state.estimate is not None and state.estimate.heater.heater is not Heater.ANSWERS:
            trip.heater = f'heater {heater_sentence(state.estimate.heater).partition(";")[0]}'
        trip.has_arrived = status.meaning.is_over
        trip.is_over = trip.has_arrived or status is Status.NO_ROUTE


def lapses_in_words(spans: list[Period]) -> str:
    """Return the number and the length of the spans without a valid command; '' for none."""
    if not spans:
        return ''
    lasted = duration_text(sum(span.length_s for span in spans))
    return f'{len(spans)} span{"" if len(spans) == 1 else "s"}, {lasted} in all'


class Instant(NamedTuple):
    """
    The course at an instant [ns]: commands to all that heats and to all that cools [W].

    Temperatures, as measured and as predicted for the arrival, in deg C; NaN: unknown.
    """

    now_ns: int
    command_w: float
    cold_w: float
    measured_c: float
    predicted_c: float


class Said(NamedTuple):
    """A sentence that holds from an instant [ns] on, and its status."""

    now_ns: int
    status: Status
    sentence: str


@dataclass
class Course:
    """
    A drive, instant by instant; filled by `add`.

    `said` has the sentence at each change of status, `signals` the names of signals in doubt by instant [ns],
    `regimes` the regime by instant [ns], each at its changes. `results` has the heater's energy and each trip.
    `arrival` is the Instant of arrival, with the measured temperature, `latest_prediction` the last one with a
    plan; None without one.
    """

    instants: list[Instant] = field(default_factory=list)
    said: list[Said] = field(default_factory=list)
    signals: list[tuple[int, str]] = field(default_factory=list)
    regimes: list[tuple[int, str]] = field(default_factory=list)
    results: TripResults = field(default_factory=TripResults)
    arrival: Instant | None = None
    latest_prediction: Instant | None = None
    _had_plan: bool = False

    def add(self, played: Played) -> None:
        """Add a step."""
        self.results.add(played)
        state, decision, recorded_w = played.state, played.state.decision, played.recorded_w
        command, measurement = state.latest_command, state.measurement
        plan = decision.plan if recorded_w is None else None
        cold_w = 0.0 if command is None else sum(
            command.power_w(source.name) for source in state.vehicle.heat_sources if source.cools)
        instant = Instant(
            played.now_ns, recorded_w if recorded_w is not None else
            0.0 if command is None else command.total_w - cold_w, cold_w,
            math.nan if measurement is None else measurement.state.temperature_c,
            math.nan if plan is None else plan.arrival_temperature_c)
        self.instants.append(instant)
        if recorded_w is None and (not self.said or self.said[-1].status is not decision.status):
            self.said.append(Said(played.now_ns, decision.status, decision.explanation))
        if plan is not None:
            self.latest_prediction = instant
        self._had_plan |= decision.plan is not None
        if self.arrival is None and decision.status.meaning.is_over and self._had_plan:
            self.arrival = instant
        for known, value in ((self.signals, ', '.join(verdict.signal for verdict in state.signal_verdicts)),
                             (self.regimes, state.regime.regime.value)):
            if not known or known[-1][1] != value:
                known.append((played.now_ns, value))

    @property
    def heating(self) -> list[Period]:
        """The periods of heating."""
        return self._periods([instant.command_w for instant in self.instants])

    @property
    def cooling(self) -> list[Period]:
        """The periods of cooling."""
        return self._periods([instant.cold_w for instant in self.instants])

    def _periods(self, powers_w: list[float]) -> list[Period]:
        periods: list[Period] = []
        begun: int | None = None
        for instant, power_w in zip(self.instants, powers_w):
            if power_w >= LEAST_HEAT_W and begun is None:
                begun = instant.now_ns
            elif power_w < LEAST_HEAT_W and begun is not None:
                periods.append(Period(begun, instant.now_ns))
                begun = None
        if begun is not None:
            periods.append(Period(begun, self.instants[-1].now_ns))
        return periods

    @property
    def energy_wh(self) -> float:
        """The electrical energy of all heat sources [Wh]: as commanded, or of a log as recorded."""
        return sum((account.delivered_wh if account.commanded_wh is None else account.commanded_wh) or 0.0
                   for account in self.results.accounts.values())

    def as_dictionary(self) -> dict[str, Any]:
        """Return its figures as plain values for JSON."""
        arrival, predicted = self.arrival, self.latest_prediction
        return {
            'start_ns': self.instants[0].now_ns, 'end_ns': self.instants[-1].now_ns, 'steps': len(self.instants),
            **{kind: [period._asdict() for period in periods]
               for kind, periods in (('heating', self.heating), ('cooling', self.cooling))},
            **self.results.energies_wh,
            'without_command': [span._asdict() for span in self.results.account.without_command],
            'results': [trip.sentences() for trip in self.results.trips],
            'arrival_ns': None if arrival is None else arrival.now_ns,
            'arrival_temperature_c': None if arrival is None else arrival.measured_c,
            'last_predicted_arrival_temperature_c': None if predicted is None else predicted.predicted_c,
            'statuses': [{'at_ns': said.now_ns, 'status': said.status.name, 'sentence': said.sentence}
                         for said in self.said],
            'signals_in_doubt': [{'at_ns': at_ns, 'signals': names} for at_ns, names in self.signals],
            'regimes': [{'at_ns': at_ns, 'regime': name} for at_ns, name in self.regimes]}


def what_if_sentence(changes: Changes, recorded: Course, changed: Course) -> str:
    """Return how the changed drive would have gone, compared with the recorded one."""
    outcome = f'{_start(recorded, changed)}{_arrival(recorded, changed)}'
    return f'With {changes_in_words(changes)} it would have {outcome}.'


def _start(recorded: Course, changed: Course) -> str:
    before, after, done = recorded.heating, changed.heating, 'heated'
    if not before and not after and (recorded.cooling or changed.cooling):
        before, after, done = recorded.cooling, changed.cooling, 'cooled'
    if not after:
        return f'not {done} either' if not before else f'not {done}'
    if not before:
        return f'started after {duration_text((after[0].from_ns - changed.instants[0].now_ns) / NS_PER_S)}'
    later_s = (after[0].from_ns - before[0].from_ns) / NS_PER_S
    if abs(later_s) < SAME_START_S:
        return 'started at the same time'
    return f'started {duration_text(abs(later_s))} {"later" if later_s > 0.0 else "earlier"}'


def _arrival(recorded: Course, changed: Course) -> str:
    energy = f' and used {changed.energy_wh:.0f} Wh instead of {recorded.energy_wh:.0f} Wh'
    arrival = changed.arrival
    if arrival is None or math.isnan(arrival.measured_c):
        return energy
    before = recorded.arrival
    instead = ('' if before is None or math.isnan(before.measured_c)
               else f' instead of {before.measured_c:.1f} degC')
    return f',{energy[4:]}, and arrived at {arrival.measured_c:.1f} degC{instead}'
