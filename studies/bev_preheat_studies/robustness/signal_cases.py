# SPDX-License-Identifier: Apache-2.0
"""Faulty signals in drawn cars: which ones are reported, how soon, and whether the heater is blamed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from time import process_time
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.control.supervisor import Supervisor
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.simulation.sensors import OtherBattery
from bev_preheat.simulation.supervised_drive import moments
from bev_preheat_studies.numbered import run_numbered
from bev_preheat_studies.robustness.car_study import settings_of_compared
from bev_preheat_studies.robustness.drawn_cars import draw_car

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from concurrent.futures import Executor

    from bev_preheat.simulation.sensors import Sensors
    from bev_preheat_studies.robustness.drawn_cars import Conditions

FEED = 'feed'
# A faulty signal must be reported within this time [s].
NAMED_WITHIN_S = 120.0


@dataclass(frozen=True)
class SignalCase:
    """
    A sensor fault: the values in `wrong` replace those of Sensors.

    `signal` is the signal to be reported; '': the readings must be refused instead. `temperature_c` [deg C] and
    `soc` replace those at the start if the case needs its own.
    """

    signal: str
    wrong: dict[str, Any]
    temperature_c: float | None = None
    soc: float | None = None

    def sensors(self, sensors: Sensors) -> Sensors:
        """Return the Sensors with this fault."""
        return replace(sensors, **self.wrong)


CASES: dict[str, SignalCase] = {
    'small battery first': SignalCase('source', {'other': OtherBattery(20.0, 0.9, 24.6, is_first=True)}, 5.0),
    'small battery second': SignalCase('source', {'other': OtherBattery(20.0, 0.9, 24.6)}, 5.0),
    'two managers': SignalCase('source', {'other': OtherBattery(24.0, 0.8, 420.0, 40.0)}, 1.0),
    'two locations': SignalCase('source', {
        'location': 'floor', 'other': OtherBattery(5.0, 0.8, 420.0, 40.0, 'trunk')}, 5.0),
    'current reversed': SignalCase('current', {'reverses_current': True}),
    'temperature 0.0': SignalCase('battery_temperature', {'temperature_stuck_at_c': 0.0}),
    'temperature -40': SignalCase('battery_temperature', {'temperature_stuck_at_c': -40.0}),
    'charge 0.0': SignalCase('state_of_charge', {'soc_stuck_at': 0.0}),
    'charge in percent': SignalCase('', {'soc_scale': 100.0}, soc=0.0112),
    'voltage 12.6': SignalCase('voltage', {'voltage_stuck_at_v': 12.6}),
    'voltage 65.535': SignalCase('voltage', {'voltage_stuck_at_v': 65.535}),
    'voltage 300': SignalCase('voltage', {'voltage_stuck_at_v': 300.0}),
    'feed every 10 s': SignalCase(FEED, {'period_s': 10.0}),
}


@dataclass(frozen=True)
class SignalResult:
    """
    One case in one drawn car; instants are seconds of the drive.

    `named_s` is when the signal was reported (None: never); `others` are other reported signals,
    `heater_verdicts` reported heater faults. `heated_after_s` is the heating time after the report [s].
    """

    number: int
    case: str
    car: int
    named_s: float | None
    others: tuple[str, ...]
    heater_verdicts: tuple[str, ...]
    switch_ons: int
    heated_after_s: float
    cpu_s: float = 0.0


def drive_case(conditions: Conditions, seed: int, number: int) -> SignalResult:
    """Return the SignalResult of a number, which counts all CASES in car 0, then in car 1, and so on."""
    started = process_time()
    name = list(CASES)[number % len(CASES)]
    case, car_number = CASES[name], number // len(CASES)
    state = conditions.state
    state = BatteryState(state.temperature_c if case.temperature_c is None else case.temperature_c,
                         state.soc if case.soc is None else case.soc)
    drawn = draw_car(replace(conditions, state=state), seed, car_number)
    car = drawn.car(case.sensors(drawn.sensors()))
    # The planner with the slow feed is configured for a state each second.
    period_s = 1.0 if case.signal == FEED else conditions.period_s
    supervisor = Supervisor(car.vehicle, settings_of_compared('planner', period_s))
    named_s: float | None = None
    others: set[str] = set()
    verdicts: dict[str, None] = {}
    switch_ons, power_w, since_s, heated_s = 0, 0.0, 0.0, 0.0
    for moment in moments(car, supervisor, lambda: car.is_over):
        if power_w > 0.0 and named_s is not None:
            heated_s += moment.time_s - since_s
        since_s = moment.time_s
        output = moment.output
        if output.command is not None:
            switch_ons += output.command.battery_heating_power_w > 0.0 == power_w
            power_w = output.command.battery_heating_power_w
        known = supervisor.state
        signals = {each.signal for each in known.signal_verdicts}
        is_named = case.signal in signals if case.signal else known.decision.status is Status.INVALID_INPUT
        if named_s is None and is_named:
            named_s = moment.time_s
        others |= signals - {case.signal}
        if known.estimate is not None and known.estimate.heater.heater is not Heater.ANSWERS:
            verdicts[known.estimate.heater.heater.value] = None
    return SignalResult(number, name, car_number, named_s, tuple(sorted(others)), tuple(verdicts), switch_ons,
                        heated_s, process_time() - started)


def run_cases(conditions: Conditions, cars: int, seed: int, executor: Executor,
              report: Callable[[SignalResult], object], finished: Mapping[int, SignalResult] | None = None,
              keep: Callable[[int, SignalResult], object] | None = None) -> list[SignalResult]:
    """Return the SignalResults of all CASES in cars 0 … `cars` - 1; arguments as for `car_study.run_study`."""
    results = []
    for result in run_numbered(executor, partial(drive_case, conditions, seed), range(cars * len(CASES)),
                               finished, keep):
        results.append(result)
        report(result)
    return results


def case_from(record: dict[str, Any]) -> SignalResult:
    """Return the SignalResult of a dictionary made by `asdict`, read back from JSON."""
    return SignalResult(**{**record, 'others': tuple(record['others']),
                           'heater_verdicts': tuple(record['heater_verdicts'])})


def summarise_cases(results: list[SignalResult]) -> dict[str, Any]:
    """Return the figures of each case by name: shares, and times until the report [s]."""
    summary = {}
    for name in CASES:
        of_case = [result for result in results if result.case == name]
        if not of_case:
            continue
        named_s = sorted(result.named_s for result in of_case if result.named_s is not None)
        summary[name] = {
            'cars': len(of_case), 'named': len(named_s) / len(of_case),
            'in_time': sum(instant_s <= NAMED_WITHIN_S for instant_s in named_s) / len(of_case),
            'median_s': float(np.median(named_s)) if named_s else None,
            'worst_s': named_s[-1] if named_s else None,
            'heater_accused': sum(bool(result.heater_verdicts) for result in of_case),
            'others_named': sum(bool(result.others) for result in of_case),
            'most_switch_ons': max(result.switch_ons for result in of_case)}
    return summary
