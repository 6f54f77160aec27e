# SPDX-License-Identifier: Apache-2.0
"""Whether a drive went as its scenario expects."""

from __future__ import annotations

from dataclasses import dataclass, field
import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.simulation.scenario import Expectations


@dataclass
class DriveRecord:
    """
    What was seen of a drive; instants are seconds of the clock since the start.

    `commands` holds (instant, power [W], reason's name) in order, `statuses` the names of all
    statuses that plans and commands had, `heater` what the diagnostics said of the heater at last.
    `arrival_c` is the true temperature on arrival, NaN where the car never arrived.
    """

    target_c: float
    commands: list[tuple[float, float, str]] = field(default_factory=list)
    statuses: set[str] = field(default_factory=set)
    heater: str = ''
    arrival_c: float = math.nan

    @property
    def switch_ons(self) -> int:
        """How often the command rose from 0 W."""
        powers_w = [0.0, *(power_w for _, power_w, _ in self.commands)]
        return sum(before == 0.0 < after for before, after in zip(powers_w, powers_w[1:]))


@dataclass(frozen=True)
class Finding:
    """One expectation: what it is about, what was expected, what was seen, whether that is good."""

    what: str
    expected: str
    seen: str
    good: bool


def evaluate(expectations: Expectations, record: DriveRecord) -> list[Finding]:
    """Return a Finding for each of a scenario's Expectations, held against a DriveRecord."""
    findings: list[Finding] = []

    def find(what: str, expected: str, seen: str, good: bool) -> None:
        findings.append(Finding(what, expected, seen, bool(good)))

    if expectations.arrival_error_k is not None:
        low, high = expectations.arrival_error_k
        error_k = record.arrival_c - record.target_c
        find('arrival error [K]', f'{low:+g} ... {high:+g}', f'{error_k:+.2f}',
             low <= error_k <= high)
    if expectations.most_switch_ons is not None:
        find('heater switched on [times]', f'at most {expectations.most_switch_ons}',
             str(record.switch_ons), record.switch_ons <= expectations.most_switch_ons)
    if expectations.statuses:
        missing = [name for name in expectations.statuses if name not in record.statuses]
        find('statuses', ', '.join(expectations.statuses),
             f'all but {", ".join(missing)}' if missing else 'all', not missing)
    if expectations.never:
        unwanted = [name for name in expectations.never if name in record.statuses]
        find('statuses', f'none of {", ".join(expectations.never)}',
             ', '.join(unwanted) or 'none', not unwanted)
    for from_s, until_s in expectations.off_during:
        most_w = max(_powers_w(record, from_s, until_s), default=math.nan)
        find(f'command from {from_s:g} to {until_s:g} s [W]', '0', f'at most {most_w:.0f}',
             most_w == 0.0)
    for from_s, until_s in expectations.heats_during:
        most_w = max(_powers_w(record, from_s, until_s), default=math.nan)
        find(f'command from {from_s:g} to {until_s:g} s [W]', 'more than 0',
             f'at most {most_w:.0f}', most_w > 0.0)
    if expectations.heater is not None:
        find('heater', expectations.heater, record.heater or 'nothing',
             record.heater == expectations.heater)
    return findings


def _powers_w(record: DriveRecord, from_s: float, until_s: float) -> list[float]:
    return [power_w for instant_s, power_w, _ in record.commands if from_s <= instant_s < until_s]
