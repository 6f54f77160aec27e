# SPDX-License-Identifier: Apache-2.0
"""Drive days with the planner's own step: verdicts, heating, and the temperature at the end of each trip."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from time import process_time
from typing import Any, TYPE_CHECKING

from bev_preheat.control.supervisor import Supervisor
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.planning.situation import BatteryState
from bev_preheat.simulation.phases import Charge, DrivePhase, Park
from bev_preheat.simulation.supervised_drive import moments
from bev_preheat.simulation.traffic import Kind
from bev_preheat.simulation.vehicle_plant import VehiclePlant
from bev_preheat_studies.numbered import run_numbered
from bev_preheat_studies.robustness.car_study import settings_of_compared
from bev_preheat_studies.robustness.drawn_days import draw_day
from bev_preheat_studies.robustness.drives import FaultWatch

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from concurrent.futures import Executor

    from bev_preheat.simulation.imperfect_car import ImperfectCar
    from bev_preheat.simulation.supervised_drive import Moment
    from bev_preheat_studies.robustness.drawn_cars import Conditions
    from bev_preheat_studies.robustness.drawn_days import DrawnDay

# Heating must end within these times after the start of charging or parking [s], plus a command period
# (docs/explanation/safety.md).
CHARGING_KNOWN_AFTER_S = 10.0
PARKED_OFF_AFTER_S = 180.0


@dataclass(frozen=True)
class TripOutcome:
    """
    Outcome of trip `position` (0: the first) of a day.

    `arrival_error_k` [K] is the true temperature on arrival above the target, or above the reachable
    temperature closest to it; None if the trip was cut short or the battery ran empty. `route` is the number
    of the route, `pace` the duration as a multiple of the route's, `is_told`: the car reported its position.
    `switch_ons` counts the rises of the command from 0 W.
    """

    position: int
    route: int
    pace: float
    is_told: bool
    arrival_error_k: float | None
    switch_ons: int


@dataclass(frozen=True)
class DayResult:
    """
    One day.

    `knows_power`: battery states carry voltage and current. `heater_verdicts` and `signal_verdicts` list all
    reported faults of the heater and of signals in order, as texts 'name, phase, instant'.
    `heated_charging_s` and `heated_parked_s` are the times [s] of commanded heating while charging or parked,
    beyond the stated times. `fault_shown_s` and `fault_found_after_s` are those of DriveOutcome, in driving
    time. `hours` is the length of the day, `cpu_s` the processor time [s].
    """

    number: int
    knows_power: bool
    trips: tuple[TripOutcome, ...]
    heater_verdicts: tuple[str, ...] = ()
    signal_verdicts: tuple[str, ...] = ()
    heated_charging_s: float = 0.0
    heated_parked_s: float = 0.0
    fault_shown_s: float | None = None
    fault_found_after_s: float | None = None
    hours: float = 0.0
    steps: int = 0
    cpu_s: float = 0.0


@dataclass
class _DayTally:
    """Counters of a day."""

    day: DrawnDay
    car: ImperfectCar
    period_s: float
    faults: FaultWatch
    heater_verdicts: list[str] = field(default_factory=list)
    signal_verdicts: list[str] = field(default_factory=list)
    heated_s: dict[type, float] = field(default_factory=lambda: {Charge: 0.0, Park: 0.0})
    switch_ons: list[int] = field(default_factory=list)
    within_c: list[tuple[float, float]] = field(default_factory=list)
    driven_s: float = 0.0
    _phase: object = None
    _power_w: float = 0.0
    _since_s: float = 0.0
    _verdict: Heater = Heater.ANSWERS
    _doubted: frozenset[str] = frozenset()

    def note(self, moment: Moment, supervisor: Supervisor) -> None:
        """Note a Moment whose command is in effect from now on."""
        car, now_s = self.car, moment.time_s
        if car.phase is not self._phase:
            self._begin(car)
        self._count_heating(now_s)
        if moment.output.command is not None:
            power_w = moment.output.command.battery_heating_power_w
            if power_w > 0.0 == self._power_w and isinstance(car.phase, DrivePhase):
                self.switch_ons[-1] += 1
            self._power_w = power_w
        known = supervisor.state
        estimate, phase_s = known.estimate, now_s - car.plant.start_s
        if isinstance(car.phase, DrivePhase):
            self.faults.note(self.driven_s + phase_s, self._power_w, estimate)
        where = f'{type(car.phase).__name__.lower()} {len(car.reports) + 1}, {phase_s:.0f} s'
        verdict = Heater.ANSWERS if estimate is None else estimate.heater.heater
        if verdict not in (Heater.ANSWERS, self._verdict):
            self.heater_verdicts.append(f'{verdict.value}, {where}')
        self._verdict = verdict
        doubted = frozenset(each.signal for each in known.signal_verdicts)
        self.signal_verdicts += [f'{name}, {where}' for name in sorted(doubted - self._doubted)]
        self._doubted = doubted

    def _count_heating(self, now_s: float) -> None:
        """Count the commanded heating time of a car that has been charging or parked beyond the allowed time."""
        phase, began_s = self.car.phase, self.car.plant.start_s
        if self._power_w > 0.0 and not isinstance(phase, DrivePhase):
            allowed_s = CHARGING_KNOWN_AFTER_S if isinstance(phase, Charge) else PARKED_OFF_AFTER_S
            from_s = max(self._since_s, began_s + allowed_s + self.period_s)
            self.heated_s[type(phase)] += max(0.0, now_s - from_s)
        self._since_s = now_s

    def _begin(self, car: ImperfectCar) -> None:
        self._phase = car.phase
        self.driven_s = sum(report.ended_s - report.started_s for report in car.reports
                            if isinstance(report.phase, DrivePhase))
        if isinstance(car.phase, DrivePhase):
            # A command that continues from the previous phase is not a switch-on of this trip.
            self.switch_ons.append(0)
            self.within_c.append((_end_c(car, 0.0), _end_c(car, car.vehicle.hvch.maximum_power_w)))

    def trips(self) -> tuple[TripOutcome, ...]:
        """Return the outcomes of the finished trips."""
        ends = [report for report in self.car.reports if isinstance(report.phase, DrivePhase)]
        outcomes = []
        for position, (end, switch_ons, (unheated_c, heated_c)) in enumerate(zip(
                ends, self.switch_ons, self.within_c)):
            assert isinstance(end.phase, DrivePhase)
            target_c = min(max(end.phase.goal.target_temperature_c, unheated_c), heated_c)
            is_cut = any(event.kind is Kind.ARRIVE_EARLY for event in end.phase.events)
            outcomes.append(TripOutcome(
                position, self.day.route_numbers[position], self.day.paces[position],
                self.day.conditions.tells_position,
                None if is_cut or end.ran_empty else end.temperature_c - target_c, switch_ons))
        return tuple(outcomes)


def _end_c(car: ImperfectCar, heater_power_w: float) -> float:
    """Return the battery temperature at the end of the drive [deg C] with a constant heater power [W]."""
    plant = car.plant
    state = BatteryState(plant.temperature_c, plant.soc, coolant_excess_k=plant.coolant_c - plant.temperature_c)
    driven = VehiclePlant(plant.vehicle, plant.route, state)
    driven.advance(driven.duration_s, heater_power_w)
    return driven.temperature_c


def drive_day(conditions: Conditions, seed: int, number: int) -> DayResult:
    """Return the DayResult of one drawn day."""
    started, steps = process_time(), 0
    day = draw_day(conditions, seed, number)
    car = day.car()
    supervisor = Supervisor(car.vehicle, settings_of_compared('planner', conditions.period_s))
    tally = _DayTally(day, car, conditions.period_s, FaultWatch(car.imperfections.heater_faults))
    try:
        for moment in moments(car, supervisor, lambda: car.is_over):
            steps += 1
            tally.note(moment, supervisor)
    except Exception as error:
        error.add_note(f'in day {number} of seed {seed}')
        raise
    trips = tally.trips()
    tally.faults.end(tally.driven_s)
    return DayResult(
        number, day.conditions.reports_power, trips, tuple(tally.heater_verdicts), tuple(tally.signal_verdicts),
        tally.heated_s[Charge], tally.heated_s[Park], tally.faults.shown_s, tally.faults.found_after_s,
        car.time_s / 3600.0, steps, process_time() - started)


def run_days(conditions: Conditions, days: int, seed: int, executor: Executor,
             report: Callable[[DayResult], object], finished: Mapping[int, DayResult] | None = None,
             keep: Callable[[int, DayResult], object] | None = None) -> list[DayResult]:
    """Return the DayResults of days 0 … `days` - 1 in order; arguments as for `car_study.run_study`."""
    results = []
    for result in run_numbered(executor, partial(drive_day, conditions, seed), range(days), finished, keep):
        results.append(result)
        report(result)
    return results


def day_from(record: dict[str, Any]) -> DayResult:
    """Return the DayResult of a dictionary made by `asdict`, read back from JSON."""
    return DayResult(**{
        **record, 'trips': tuple(TripOutcome(**trip) for trip in record['trips']),
        'heater_verdicts': tuple(record['heater_verdicts']), 'signal_verdicts': tuple(record['signal_verdicts'])})
