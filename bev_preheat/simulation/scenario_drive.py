# SPDX-License-Identifier: Apache-2.0
"""Drives a car, or a scenario's, under the planner's own step, and compares it with expectations; no ROS."""
from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
import math
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.control.settings import settings_of
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.supervised_drive import Moment, moments, Wire
from bev_preheat.simulation.traffic import clock_offset_s
from bev_preheat.vehicle.description import HVCH

if TYPE_CHECKING:
    from bev_preheat.control.decision import Command
    from bev_preheat.control.state import State
    from bev_preheat.simulation.imperfect_car import ImperfectCar, PhaseReport
    from bev_preheat.simulation.scenario import Expectations, Scenario

# Word of the diagnostics for a heater without a fault.
HEALTHY = 'answers'
# Signals that may be in doubt.
SIGNALS = frozenset(('battery_temperature', 'state_of_charge', 'voltage', 'current', 'source', 'feed'))


class PhaseEnd(NamedTuple):
    """A phase that has ended: its instants [s], the true temperature [deg C], NaN if the battery is empty."""

    started_s: float
    ended_s: float
    arrival_c: float


@dataclass
class DriveRecord:
    """
    Observations of a drive, or of one phase of a chain; instants are seconds of the clock since the start.

    `commands` holds (instant, power of all heat sources [W], reason's name) in order, `by_source` the Command of
    each; `statuses` the names of all statuses of plans and commands. `arrival_c` is the true temperature at the
    end of the drive, NaN without an arrival. `heater_verdicts` holds (instant, verdict of the diagnostics on the
    heater and on other faulty heat sources) at each change, `regimes` (instant, name), `signals` (instant, name)
    at each new doubt. `hottest_heated_c` is the highest temperature [deg C] at which more than 0 W was commanded,
    -inf without such a command. `phases` are the records of all phases, whose instants count from their start.
    """

    target_c: float
    commands: list[tuple[float, float, str]] = field(default_factory=list)
    statuses: set[str] = field(default_factory=set)
    arrival_c: float = math.nan
    heater_verdicts: list[tuple[float, str]] = field(default_factory=list)
    regimes: list[tuple[float, str]] = field(default_factory=list)
    signals: list[tuple[float, str]] = field(default_factory=list)
    hottest_heated_c: float = -math.inf
    phases: list[DriveRecord] = field(default_factory=list)
    by_source: list[Command] = field(default_factory=list)
    _doubted: frozenset[str] = frozenset()

    @property
    def heater(self) -> str:
        """The last verdict on the heater, '' without any."""
        return self.heater_verdicts[-1][1] if self.heater_verdicts else ''

    def note_command(self, instant_s: float, command: Command, battery_c: float) -> None:
        """Record a Command to a battery of a temperature [deg C]."""
        self.commands.append((instant_s, command.total_w, command.reason.name))
        self.by_source.append(command)
        self.statuses.add(command.reason.name)
        if command.total_w > 0.0:
            self.hottest_heated_c = max(self.hottest_heated_c, battery_c)

    def note_heaters(self, instant_s: float, hvch: str, others: Mapping[str, str]) -> None:
        """Record the verdicts on the HVCH and on other heat sources by name at an instant [s]."""
        faulty = [each for each in (hvch, *(f'{name} {verdict}' for name, verdict in others.items()))
                  if not each.endswith(HEALTHY)]
        if (said := ', '.join(faulty) or HEALTHY) != self.heater:
            self.heater_verdicts.append((instant_s, said))

    def note_signals(self, instant_s: float, names: Collection[str]) -> None:
        """Record the signals in doubt at an instant [s]."""
        self.signals += [(instant_s, name) for name in names if name not in self._doubted]
        self._doubted = frozenset(names)

    @property
    def switched_on_s(self) -> list[float]:
        """The instants [s] at which the command of a heat source rose from 0 W, once for each source."""
        names = {HVCH, *(name for command in self.by_source for name, _ in command.sources_w)}
        return [instant_s for (instant_s, *_), command, before in zip(
            self.commands, self.by_source, [None, *self.by_source]) for name in names
            if command.power_w(name) > 0.0 and (before is None or before.power_w(name) == 0.0)]

    @property
    def switch_ons(self) -> int:
        """Number of times that a heat source was switched on."""
        return len(self.switched_on_s)

    def during(self, from_s: float, until_s: float, target_c: float, arrival_c: float) -> DriveRecord:
        """Return the DriveRecord of the phase in a span [s] that ends at `arrival_c` [deg C]."""
        def shifted(records: list[Any]) -> list[Any]:
            return [(record[0] - from_s, *record[1:]) for record in records if from_s <= record[0] < until_s]

        commands = shifted(self.commands)
        by_source = [command for (instant_s, *_), command in zip(self.commands, self.by_source)
                     if from_s <= instant_s < until_s]
        before = [(0.0, said) for instant_s, said in self.heater_verdicts if instant_s < from_s][-1:]
        return DriveRecord(
            target_c, commands, {reason for _, _, reason in commands}, arrival_c,
            before + shifted(self.heater_verdicts), shifted(self.regimes), shifted(self.signals),
            self.hottest_heated_c, by_source=by_source)


@dataclass(frozen=True)
class Finding:
    """One expectation: its subject, the expected and the observed value, and whether it is met."""

    what: str
    expected: str
    seen: str
    good: bool


def evaluate(expectations: Expectations, record: DriveRecord) -> Iterator[Finding]:
    """Yield a Finding for each of a scenario's Expectations, compared with a DriveRecord."""
    def unwanted(what: str, expected: str, seen: Collection[str]) -> Finding:
        return Finding(what, expected, ', '.join(seen) or 'none', not seen)

    if expectations.arrival_error_k is not None:
        low, high = expectations.arrival_error_k
        error_k = record.arrival_c - record.target_c
        yield Finding('arrival error [K]', f'{low:+g} ... {high:+g}', f'{error_k:+.2f}',
                      bool(low <= error_k <= high))
    if expectations.most_switch_ons is not None:
        yield Finding('heater switched on [times]', f'at most {expectations.most_switch_ons}',
                      str(record.switch_ons), record.switch_ons <= expectations.most_switch_ons)
    if expectations.statuses:
        missing = [name for name in expectations.statuses if name not in record.statuses]
        yield Finding('statuses', ', '.join(expectations.statuses),
                      f'all but {", ".join(missing)}' if missing else 'all', not missing)
    if expectations.never:
        yield unwanted('statuses', f'none of {", ".join(expectations.never)}',
                       [name for name in expectations.never if name in record.statuses])
    for spans, expected, heats in ((expectations.off_during, '0', False),
                                   (expectations.heats_during, 'more than 0', True)):
        for from_s, until_s in spans:
            most_w = max((power_w for instant_s, power_w, _ in record.commands if from_s <= instant_s < until_s),
                         default=math.nan)
            yield Finding(f'command from {from_s:g} to {until_s:g} s [W]', expected, f'at most {most_w:.0f}',
                          most_w > 0.0 if heats else most_w == 0.0)
    for regime, from_s, until_s in expectations.regime_during:
        seen = sorted({name for instant_s, name in record.regimes if from_s <= instant_s < until_s})
        yield Finding(f'regime from {from_s:g} to {until_s:g} s', regime, ', '.join(seen) or 'none',
                      seen == [regime])
    if expectations.never_regimes:
        yield unwanted('regimes', f'none of {", ".join(expectations.never_regimes)}',
                       sorted({name for _, name in record.regimes} & set(expectations.never_regimes)))
    if expectations.not_heated_above_c is not None:
        yield Finding('warmest battery that was heated [deg C]', f'at most {expectations.not_heated_above_c:g}',
                      f'{record.hottest_heated_c:.2f}',
                      bool(record.hottest_heated_c <= expectations.not_heated_above_c))
    if expectations.heater is not None:
        yield Finding('heater', expectations.heater, record.heater or 'nothing',
                      record.heater == expectations.heater)
    if expectations.never_heater_verdict:
        yield unwanted('verdicts on the heater', 'none',
                       sorted({said for _, said in record.heater_verdicts} - {HEALTHY}))
    for name in expectations.signals:
        named_s = min((instant_s for instant_s, each in record.signals if each == name), default=math.inf)
        within_s = expectations.named_within_s
        yield Finding(f'signal {name}', 'named' if within_s is None else f'named within {within_s:g} s',
                      f'after {named_s:.1f} s' if named_s < math.inf else 'not named',
                      named_s < math.inf if within_s is None else named_s <= within_s)
    if expectations.no_signals:
        yield unwanted('signals in doubt', 'none', sorted({name for _, name in record.signals}))


def fill_phases(record: DriveRecord, scenario: Scenario, ends: Iterable[PhaseEnd | PhaseReport]) -> None:
    """Fill in the records of a Scenario's phases from their ends."""
    jumps = scenario.imperfections.clock_jumps
    for phase, end in zip(scenario.phases, ends):
        from_s, until_s = (at_s + clock_offset_s(jumps, at_s) for at_s in (end.started_s, end.ended_s))
        record.phases.append(record.during(
            from_s, until_s, phase.wanted_c if isinstance(phase, DrivePhase) else math.nan, end.arrival_c))
    if record.phases:
        record.arrival_c = record.phases[0].arrival_c


def evaluate_chain(expectations: Expectations, of_phases: Sequence[Expectations | None],
                   record: DriveRecord) -> list[Finding]:
    """Return the Findings of `evaluate` for the whole drive, then for each phase with expectations."""
    findings = list(evaluate(expectations, record))
    for number, (expected, phase) in enumerate(zip(of_phases, record.phases), start=1):
        if expected is not None:
            findings += [replace(finding, what=f'phase {number}: {finding.what}')
                         for finding in evaluate(expected, phase)]
    if len(record.phases) < len(of_phases):
        findings.append(Finding('phases', str(len(of_phases)), str(len(record.phases)), False))
    return findings


# The planner is observed for this long after the arrival [s].
AFTERWARDS_S = 120.0


def drive_scenario(
        scenario: Scenario,
        progress: Callable[[float, float], object] = lambda time_s, total_s: None,
        wire: Callable[[Supervisor], Wire] = Wire) -> DriveRecord:
    """Return the DriveRecord of a Scenario; calls `progress(time_s, total_s)`; `wire(supervisor)`: its Wire."""
    car = scenario.car()
    record = drive_observed(car, Supervisor(scenario.vehicle, settings_of(scenario.planner)),
                            scenario.first.wanted_c, AFTERWARDS_S, progress, wire)
    fill_phases(record, scenario, car.reports)
    return record


def drive_observed(
        car: ImperfectCar, supervisor: Supervisor, target_c: float, afterwards_s: float = 0.0,
        progress: Callable[[float, float], object] = lambda time_s, total_s: None,
        wire: Callable[[Supervisor], Wire] = Wire) -> DriveRecord:
    """Return the DriveRecord of a car under a Supervisor, until `afterwards_s` [s] after its last phase."""
    record = DriveRecord(target_c)
    ended_s = math.inf

    def is_over() -> bool:
        nonlocal ended_s
        if car.is_over:
            ended_s = min(ended_s, car.time_s)
        return car.time_s >= ended_s + afterwards_s

    for moment in moments(car, supervisor, is_over, wire=wire(supervisor)):
        _note(record, moment, supervisor.state, car)
        progress(car.time_s, max(car.time_s, car.longest_s) + afterwards_s)
    return record


def _note(record: DriveRecord, moment: Moment, state: State, car: ImperfectCar) -> None:
    output = moment.output
    if output.decision is not None:
        record.statuses.add(output.decision.status.name)
    if output.command is not None:
        record.note_command(moment.clock_s, output.command, car.plant.temperature_c)
    if state.estimate is not None and not car.is_over:
        record.note_heaters(moment.clock_s, state.estimate.heater.heater.value, {
            name: report.heater.value for name, report in state.source_reports.items()})
    record.regimes.append((moment.clock_s, state.regime.regime.value))
    record.note_signals(moment.clock_s, {verdict.signal for verdict in state.signal_verdicts})
