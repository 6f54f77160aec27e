# SPDX-License-Identifier: Apache-2.0
"""
Whether the temperature follows the battery, by the drive and the heat that the battery's power shows.

The model's expected change is integrated since the reading last moved. The heater's heat counts only as
far as its power was measured, because a heater that takes no power explains a cold battery.
"""
from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import dropwhile
import math
from typing import NamedTuple

from bev_preheat.estimation.readings import MeasuredState, Resolution, TEMPERATURE_STEPS_K
from bev_preheat.numerics import mean_magnitude, NS_PER_S, SATURATING_FLOATS
from bev_preheat.tunables import (
    BELOW_AMBIENT_K,
    COLDEST_IN_SUMMER_C,
    COMPARED_EVERY_S,
    LONGEST_GAP_S,
    SEEN_OVER_S,
    STUCK_BESIDE_LAGS_K,
    STUCK_K,
    STUCK_LAGS_S,
    STUCK_WITHIN_S,
    UNMOVED_K,
)
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.variants import DriveInputs, DriveRates, KEPT_VEHICLES, make_drive_rates


class _Expected(NamedTuple):
    """An instant [s], and the change expected until then [K]."""

    instant_s: float
    change_k: float


class StuckTemperature(NamedTuple):
    """
    Whether the temperature follows the battery; `doubt` is the sentence, '' while it does.

    `reading_c` [deg C] is the latest reading, None: the next one does not follow it. `since_s` [s] is the instant
    since which it has not moved, `expected` the course expected since then.
    """

    doubt: str = ''
    reading_c: float | None = None
    since_s: float = 0.0
    expected: tuple[_Expected, ...] = ()
    has_ever_moved: bool = False

    def without_instants(self) -> StuckTemperature:
        """Return the watch that starts again at the next reading, without a doubt."""
        return StuckTemperature(has_ever_moved=self.has_ever_moved)

    def seen(self, instant_s: float, reading_c: float, step_k: float, rate_k_per_s: float,
             ambient_c: float | None) -> StuckTemperature:
        """
        Return the watch after another reading.

        Instant [s], reading and ambient temperature [deg C] (None: unknown), step of the sensor [K],
        rate at which the model expects the temperature to change [K/s].
        """
        before_c, expected = self.reading_c, self.expected
        begun = self._replace(reading_c=reading_c, since_s=instant_s, expected=(_Expected(instant_s, 0.0),))
        if ambient_c is not None and reading_c < min(ambient_c - BELOW_AMBIENT_K, COLDEST_IN_SUMMER_C):
            return begun._replace(doubt=(
                f'temperature: {reading_c:.1f} degC is {ambient_c - reading_c:.1f} K below the ambient '
                f'temperature of {ambient_c:.1f} degC; at most {BELOW_AMBIENT_K:g} K are possible, or '
                f'{COLDEST_IN_SUMMER_C:g} degC from a cool garage; the field may not be set'))
        if before_c is None:
            return begun._replace(doubt='')
        if abs(reading_c - before_c) > UNMOVED_K:
            return begun._replace(doubt='', has_ever_moved=True)
        elapsed_s = instant_s - expected[-1].instant_s
        if not 0.0 <= elapsed_s <= LONGEST_GAP_S:
            return begun
        expected = tuple(dropwhile(
            lambda each: each.instant_s < instant_s - STUCK_WITHIN_S,
            (*expected, _Expected(instant_s, expected[-1].change_k + rate_k_per_s * elapsed_s))))
        first, last = expected[0], expected[-1]
        change_k, elapsed_s = last.change_k - first.change_k, last.instant_s - first.instant_s
        held_back_k = STUCK_BESIDE_LAGS_K + (STUCK_LAGS_S * abs(change_k) / elapsed_s if elapsed_s > 0.0 else 0.0)
        if abs(change_k) <= max(STUCK_K, held_back_k) + step_k:
            return self._replace(expected=expected)
        still = f'for {instant_s - self.since_s:.0f} s' if self.has_ever_moved else 'since the first state'
        direction = 'warmed' if change_k > 0.0 else 'cooled'
        return self._replace(expected=expected, doubt=(
            f'temperature: has read {reading_c:.2f} degC {still}, while the battery must have '
            f'{direction} by {abs(change_k):.1f} K; the field may not be set'))


class TemperatureCheck(NamedTuple):
    """
    The StuckTemperature, with the steps of the sensor.

    `seen_w` is the battery's power beyond that of drive and consumers, `commanded_w` that of the commands to the
    heat sources, `heat_w` their heat as HVCH power, each over about SEEN_OVER_S [W]. `stamp_ns` [ns] is that of
    the latest battery state, None: unknown, `compared_ns` that of the latest comparison.
    """

    stuck: StuckTemperature = StuckTemperature()
    steps: Resolution = Resolution(TEMPERATURE_STEPS_K)
    seen_w: float = 0.0
    commanded_w: float = 0.0
    heat_w: float = 0.0
    stamp_ns: int | None = None
    compared_ns: int = 0

    def without_instants(self) -> TemperatureCheck:
        """Return the check that starts again at the next battery state."""
        return self._replace(stuck=self.stuck.without_instants(), stamp_ns=None)

    def seen(self, measurement: MeasuredState, drive: DriveInputs | None, command_w: float, heat_w: float,
             vehicle: Vehicle, is_at_rest: bool = False) -> TemperatureCheck:
        """
        Return the check after a MeasuredState in a drive under a command [W]; None: the drive is unknown.

        `heat_w` is the heat of the commanded power as HVCH power [W], below 0 if it cools. A battery that
        `is_at_rest` charges or stands beside the drive: its power is that of no drivetrain.
        """
        state, now_ns, power_w = measurement.state, measurement.stamp_ns, measurement.power_w
        steps = self.steps.seen(state.temperature_c)
        if drive is None:
            return self._replace(stuck=self.stuck.without_instants(), steps=steps, stamp_ns=now_ns)
        if is_at_rest:
            drive = replace(drive, speed_mps=0.0, propulsion_power_w=0.0, power_variance_w2=0.0,
                            propulsion_power_magnitude_w=0.0)
        seen_w, commanded_w, mean_heat_w = self.seen_w, self.commanded_w, self.heat_w
        if power_w is not None:
            elapsed_s = 0.0 if self.stamp_ns is None else (now_ns - self.stamp_ns) / NS_PER_S
            share = 1.0 if elapsed_s <= 0.0 else 1.0 - math.exp(-elapsed_s / SEEN_OVER_S)
            others_w = drive.propulsion_power_w + drive.cabin_heating_power_w + drive.auxiliary_power_w
            seen_w += share * (power_w - others_w - seen_w)
            commanded_w += share * (command_w - commanded_w)
            mean_heat_w += share * (heat_w - mean_heat_w)
        if 0 <= now_ns - self.compared_ns < COMPARED_EVERY_S * NS_PER_S:
            return TemperatureCheck(self.stuck, steps, seen_w, commanded_w, mean_heat_w, now_ns, self.compared_ns)
        # The heater takes no more than the battery's power shows.
        heater_w = 0.0 if power_w is None or commanded_w <= 0.0 else (
            mean_heat_w * min(max(seen_w, 0.0) / commanded_w, 1.0))
        if is_at_rest and power_w is not None:
            # The model takes power without a consumer for propulsion.
            drive = replace(drive, auxiliary_power_w=power_w - heater_w - drive.cabin_heating_power_w)
        rate_k_per_s, _, _ = _rates(vehicle)(state.temperature_c, state.soc, (1.0,) * 6, replace(
            drive, heater_power_w=heater_w, terminal_power_w=power_w,
            power_variance_w2=0.0 if power_w is not None else drive.power_variance_w2))
        stuck = self.stuck.seen(
            now_ns / NS_PER_S, state.temperature_c, steps.step, rate_k_per_s, drive.ambient_temperature_c)
        return TemperatureCheck(stuck, steps, seen_w, commanded_w, mean_heat_w, now_ns, now_ns)


@lru_cache(maxsize=KEPT_VEHICLES)
def _rates(vehicle: Vehicle) -> DriveRates:
    return make_drive_rates(
        vehicle, SATURATING_FLOATS, lambda mean, variance: float(mean_magnitude(mean, variance)))
