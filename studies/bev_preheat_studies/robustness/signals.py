# SPDX-License-Identifier: Apache-2.0
"""Faulty signals in drawn cars: which ones are reported, how soon, and whether the heater is blamed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rich.console import Console

from bev_preheat.commands.terminal import print_records
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.simulation.sensors import OtherBattery
from bev_preheat_studies.robustness.drawn_cars import Conditions, draw_car
from bev_preheat_studies.robustness.driven import drive, heater_faults_in, settings_of_compared
from bev_preheat_studies.study import text_of

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
    `heater_verdicts` reported heater faults.
    """

    number: int
    case: str
    car: int
    named_s: float | None
    others: tuple[str, ...]
    heater_verdicts: tuple[str, ...]
    switch_ons: int


def drive_case(conditions: Conditions, seed: int, number: int) -> SignalResult:
    """Return the SignalResult of a number, which counts all CASES in car 0, then in car 1, and so on."""
    name = list(CASES)[number % len(CASES)]
    case, car_number = CASES[name], number // len(CASES)
    state = conditions.state
    state = BatteryState(state.temperature_c if case.temperature_c is None else case.temperature_c,
                         state.soc if case.soc is None else case.soc)
    drawn = draw_car(replace(conditions, state=state), seed, car_number)
    # The planner with the slow feed is configured for a state each second.
    settings = settings_of_compared('planner', 1.0 if case.signal == FEED else conditions.period_s)
    car = drawn.car(replace(drawn.sensors(), **case.wrong))
    record = drive(car, settings, conditions.goal.target_temperature_c)
    named = record.signals if case.signal else [
        (at_s, '') for at_s, _, reason in record.commands if reason == Status.INVALID_INPUT.name]
    return SignalResult(
        number, name, car_number, min((at_s for at_s, signal in named if signal == case.signal), default=None),
        tuple(sorted({signal for _, signal in record.signals} - {case.signal})), heater_faults_in(record),
        record.switch_ons)


def summarise_cases(results: Sequence[SignalResult]) -> dict[str, Any]:
    """Return the figures of each case by name: shares, and times until the report [s]."""
    summary = {}
    for name in dict.fromkeys(result.case for result in results):
        of_case = [result for result in results if result.case == name]
        named_s = [result.named_s for result in of_case if result.named_s is not None]
        summary[name] = {
            'cars': len(of_case), 'named': len(named_s) / len(of_case),
            'in_time': sum(instant_s <= NAMED_WITHIN_S for instant_s in named_s) / len(of_case),
            'median_s': float(np.median(named_s)) if named_s else None, 'worst_s': max(named_s, default=None),
            'heater_accused': sum(bool(result.heater_verdicts) for result in of_case),
            'others_named': sum(bool(result.others) for result in of_case),
            'most_switch_ons': max(result.switch_ons for result in of_case)}
    return summary


def print_cases(console: Console, summary: dict[str, Any]) -> None:
    """Print the table of a summary."""
    print_records(
        console, 'Faulty signals',
        ('case', 'cars', 'reported [%]', f'within {NAMED_WITHIN_S:.0f} s [%]', 'after, median [s]',
         '… most [s]', 'heater blamed', 'others reported', 'most switch-ons'),
        [(name, str(each['cars']), f'{100 * each["named"]:.0f}', f'{100 * each["in_time"]:.0f}',
          text_of(each['median_s'], '.0f'), text_of(each['worst_s'], '.0f'), str(each['heater_accused']),
          str(each['others_named']), str(each['most_switch_ons'])) for name, each in summary.items()],
        ('left', *8 * ('right',)))
