# SPDX-License-Identifier: Apache-2.0
"""
A step of a run that keeps the battery's limits at its end, too.

Power is constant over a step, but charge, temperature and with them the limits change: on a climb the discharge
limit falls with the charge, and on a descent a fuller battery accepts less. The limits at the end depend slightly
on the power. If the power allowed at the start exceeds them, the heater gives way, or heater and friction brake
take more, until they hold.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from bev_preheat.planning.bracketing import follow_slope, Trial
from bev_preheat.tunables import BELOW_HIGHEST_K, END_TOLERANCE_W

if TYPE_CHECKING:
    from bev_preheat.vehicle.model import TerminalLimits

# States and powers of a step: charge and temperature at its end come first; heater (its command) and friction
# brake [W] come first, and third, for a heater with lag, its mean power.
Driven = tuple[tuple[float, ...], tuple[float, ...]]
# `drive(least_w, most_w)` -> outcome of the step between two terminal powers [W].
DriveBetween = Callable[[float, float], Driven]


def drive_to_end(limits: TerminalLimits[float], state: tuple[float, float], variance_w2: float,
                 hottest_c: float, idle_w: float, propulsion_w: float, may_overcharge: bool,
                 drive: DriveBetween) -> Driven:
    """
    Return the outcome of a step that keeps the limits at both ends, as far as heater and brake can.

    `state` is charge and temperature [deg C] at the start, `variance_w2` the variance of the step's power,
    `idle_w` its terminal power without heater and brake, including the propulsion power `propulsion_w`. If driving
    alone exceeds the discharge limit at the end, the heater gets nothing, as at the start.
    """
    least_w, most_w = limits(*state, variance_w2)

    def terminal_w(driven: Driven) -> float:
        powers_w = driven[1]
        return idle_w + powers_w[0 if len(powers_w) == 2 else 2] + powers_w[1]

    def limits_at_end_w(driven: Driven) -> tuple[float, float]:
        soc, temperature_c = driven[0][:2]
        return limits(min(soc, 1.0), min(temperature_c, hottest_c), variance_w2)

    driven = drive(least_w, most_w)
    if driven[0][0] <= 0.0:
        # The charge runs out in this step.
        return driven
    power_w = terminal_w(driven)
    least_end_w, most_end_w = limits_at_end_w(driven)
    if power_w > most_end_w and driven[1][0] > 0.0:
        def discharged(most_w: float, driven: Driven) -> Trial[Driven]:
            spare_w = limits_at_end_w(driven)[1] - terminal_w(driven)
            return Trial(most_w, spare_w - 0.5 * END_TOLERANCE_W, driven)

        return _as_much_as_needed(
            idle_w, -1.0, discharged(power_w, driven),
            lambda most_w: discharged(most_w, drive(least_w, most_w)))
    if may_overcharge and power_w < least_end_w and driven[1][1] < -propulsion_w:
        def charged(least_w: float, driven: Driven) -> Trial[Driven]:
            spare_w = terminal_w(driven) - limits_at_end_w(driven)[0]
            return Trial(least_w, spare_w - 0.5 * END_TOLERANCE_W, driven)

        return _as_much_as_needed(
            idle_w - propulsion_w, 1.0, charged(power_w, driven),
            lambda least_w: charged(least_w, drive(least_w, most_w)))
    return driven


def warmth_beyond(heater_w: float, paid_w: float, end_c: float, highest_c: float) -> tuple[float, float]:
    """
    Return the least heater power [W] of a step that ends too warm [deg C], and its excess temperature [K].

    Paid heat ends at `highest_c`; surplus (power beyond `paid_w`) goes to the brake from BELOW_HIGHEST_K below.
    """
    return (paid_w, end_c - (highest_c - BELOW_HIGHEST_K)) if heater_w > paid_w else (0.0, end_c - highest_c)


def _as_much_as_needed(utmost_w: float, slope: float, first: Trial[Driven],
                       attempt: Callable[[float], Trial[Driven]]) -> Driven:
    """Return the step whose terminal power [W] is moved towards the utmost until the limit holds."""
    trial = follow_slope(utmost_w, first.value, first, slope, attempt, 0.5 * END_TOLERANCE_W)
    if trial.excess < -0.5 * END_TOLERANCE_W and trial.value != utmost_w:
        # In a long step less heat may lower the limit by more than it saves: then nothing keeps the limit.
        trial = attempt(utmost_w)
    return trial.outcome
