# SPDX-License-Identifier: Apache-2.0
"""Constraints that cannot be kept: by how much, where, and in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bev_preheat.nonlinear_program.program import ProgramSolution
    from bev_preheat.planning.trip import Trip

# Constraints that may have a deficit.
TARGET = 'target temperature'
ARRIVAL_SOC = 'state of charge on arrival'
LOWEST_SOC = 'lowest state of charge'
DISCHARGE_POWER = 'discharge power'
HIGHEST_SOC = 'highest state of charge'
HIGHEST_TEMPERATURE = 'highest battery temperature'
CHARGE = 'charge'
# Slacks below these are rounding.
TOLERANCE_K = 1e-5
SLACK_SOC_TOLERANCE = 1e-7
TOLERANCE_W = 1e-2


@dataclass(frozen=True)
class StepDeficit:
    """A constraint that cannot be kept, and by how much; `text` describes it."""

    constraint: str
    amount: float
    unit: str
    text: str


def find_deficits(trip: Trip, solution: ProgramSolution) -> Iterator[StepDeficit]:
    """Yield the deficits of a solution."""
    soc, slacks = solution.soc, solution.slacks
    if slacks.target_k > TOLERANCE_K:
        yield StepDeficit(TARGET, slacks.target_k, 'K',
                          f'target temperature: missed by {slacks.target_k:.2f} K')
    if slacks.soc[-1] > SLACK_SOC_TOLERANCE:
        percent = 100.0 * float(slacks.soc[-1])
        yield StepDeficit(ARRIVAL_SOC, percent, '%',
                          f'state of charge on arrival: {percent:.2f} % short')
    at = int(np.argmax(slacks.soc))
    # A battery that is emptiest on arrival has been reported above.
    if slacks.soc[at] > SLACK_SOC_TOLERANCE and soc[at + 1] < soc[-1]:
        percent = 100.0 * float(slacks.soc[at])
        yield StepDeficit(LOWEST_SOC, percent, '%',
                          f'state of charge: {percent:.2f} % below its range at '
                          f'{trip.time_s[at + 1]:.0f} s')
    at = int(np.argmax(slacks.discharge_w))
    if slacks.discharge_w[at] > TOLERANCE_W:
        deficit_w = float(slacks.discharge_w[at])
        yield StepDeficit(DISCHARGE_POWER, deficit_w, 'W',
                          f'discharge power: {deficit_w / 1e3:.2f} kW cannot be delivered at '
                          f'{trip.time_s[at]:.0f} s')
    at = int(np.argmax(slacks.soc_above))
    if slacks.soc_above[at] > SLACK_SOC_TOLERANCE:
        percent = 100.0 * float(slacks.soc_above[at])
        yield StepDeficit(HIGHEST_SOC, percent, '%',
                          f'state of charge: {percent:.2f} % above its range at '
                          f'{trip.time_s[at + 1]:.0f} s')
    # Without a slack, too, because the range may be relaxed.
    beyond_k = solution.temperature_c[1:] - trip.vehicle.battery.temperature_range_c[1]
    at = int(np.argmax(beyond_k))
    if beyond_k[at] > TOLERANCE_K:
        above_k = float(beyond_k[at])
        yield StepDeficit(HIGHEST_TEMPERATURE, above_k, 'K',
                          f'battery temperature: {above_k:.2f} K above its range at '
                          f'{trip.time_s[at + 1]:.0f} s')
