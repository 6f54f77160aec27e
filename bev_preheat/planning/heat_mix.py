# SPDX-License-Identifier: Apache-2.0
"""
The cheapest mix of a car's heat sources in each step of a trip.

A plan's control is one number, the heat wanted of the battery, as the HVCH power that gives it; with the HVCH
alone, heat and electrical power are the same number. Other sources give the same heat for another electrical
power, which depends on the air and on the battery at the start of the step. Sources serve in the order of their
merit: the electrical power is then a convex, piecewise linear function of the heat, and no other mix takes less.
Heat below 0 is cooling, by sources whose heat per watt is negative, in the order of their own merit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np

from bev_preheat.numerics import AnyNumber, ARRAYS, FloatArray, IntArray
from bev_preheat.route.segments import Route
from bev_preheat.tunables import FIRST_STEP_K, LEAST_SOURCE_W, ROUNDING_W
from bev_preheat.vehicle.description import HeatSource, HVCH, STANDING_MPS, steps_below_w, Vehicle

# A segment lasts for many commands.
KEPT_SEGMENTS = 8


@dataclass(frozen=True)
class Alone:
    """The HVCH alone, at all instants: its heat is its power, which the trip limits."""

    ends_w: ClassVar[tuple[AnyNumber, ...]] = ()
    cold_ends_w: ClassVar[tuple[AnyNumber, ...]] = ()
    is_alone: ClassVar[bool] = True
    cools: ClassVar[bool] = False
    heating: ClassVar[int] = 0

    def at(self, k: int, temperature_c: AnyNumber) -> Alone:
        """Return the HVCH, as in any step k and at any battery temperature [deg C]."""
        return self

    def electric_w(self, heat_w: AnyNumber) -> AnyNumber:
        """Return the heat."""
        return heat_w

    heat_w = capped_w = electric_w

    def cold_w(self, electric_w: AnyNumber) -> AnyNumber:
        """Return 0: the HVCH does not cool."""
        return 0.0

    def split_w(self, heat_w: FloatArray, temperature_c: FloatArray) -> dict[str, FloatArray]:
        """Return nothing: there is nothing to split."""
        return {}

    def for_core(self) -> tuple[FloatArray, ...]:
        """Return nothing: the core needs nothing."""
        return ()


ALONE = Alone()


class Sources(NamedTuple):
    """
    Heat and electrical power [W] of the sources by merit, (S,) or (S, P): `heating` ones, then the others.

    Its heats and electrical powers are floats or arrays (P,) of the temperatures, as those of ALONE.
    """

    heats_w: list[AnyNumber]
    powers_w: list[AnyNumber]
    heating: int

    @property
    def is_alone(self) -> bool:
        """Whether the HVCH is the only source."""
        return False

    @property
    def ends_w(self) -> list[AnyNumber]:
        """The heat of the best source, of the two best, and so on."""
        return list(np.cumsum(self.heats_w[:self.heating], axis=0))

    @property
    def cold_ends_w(self) -> list[AnyNumber]:
        """The heat of the best cooling source, of the two best, and so on, below 0."""
        return list(np.cumsum(self.heats_w[self.heating:], axis=0))

    def electric_w(self, heat_w: AnyNumber) -> AnyNumber:
        """Return the least electrical power of a heat; heat beyond that of all sources is left out."""
        return _along(heat_w, self.heats_w, self.powers_w)

    def heat_w(self, electric_w: AnyNumber) -> AnyNumber:
        """Return the most heat of an electrical power."""
        return _along(electric_w, self.powers_w[:self.heating], self.heats_w)

    def cold_w(self, electric_w: AnyNumber) -> AnyNumber:
        """Return the least heat of an electrical power, at most 0."""
        return _along(electric_w, self.powers_w[self.heating:], self.heats_w[self.heating:])

    def capped_w(self, heat_w: AnyNumber) -> AnyNumber:
        """Return the part of a heat that the sources give, without a source that would give next to nothing."""
        return sum((part * (abs(part) >= LEAST_SOURCE_W) for part, _ in parts(heat_w, self.heats_w)), 0.0)


def parts(value: AnyNumber, widths: list[AnyNumber]) -> Iterator[tuple[AnyNumber, AnyNumber]]:
    """
    Yield the part of a value in each width, filled one after the other, and its share of the width.

    Widths below 0 take a value below 0, the others one above.
    """
    is_float = not isinstance(value, np.ndarray)
    for width in widths:
        if is_float:
            part = max(min(value, width), 0.0) if width >= 0.0 else min(max(value, width), 0.0)
            yield part, part / (width or 1.0)
        else:
            part = np.maximum(np.minimum(value, np.maximum(width, 0.0)), np.minimum(width, 0.0))
            yield part, part / np.where(width == 0.0, 1.0, width)
        value = value - part


def _along(value: AnyNumber, widths: list[AnyNumber], others: list[AnyNumber]) -> AnyNumber:
    total: AnyNumber = 0.0
    for (_, share), other in zip(parts(value, widths), others):
        total = total + share * other
    return total


@dataclass(frozen=True, eq=False)
class HeatMix:
    """
    The sources of a vehicle along a route, the HVCH first, the cooling ones last.

    `hvch_limit_w` (N,) is the power of the HVCH [W].
    """

    is_alone: ClassVar[bool] = False

    vehicle: Vehicle
    route: Route
    hvch_limit_w: FloatArray

    @cached_property
    def _others(self) -> tuple[HeatSource, ...]:
        return tuple(sorted(self.vehicle.heat_sources, key=lambda source: source.cools))

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the sources."""
        return (HVCH, *(source.name for source in self._others))

    @cached_property
    def heating(self) -> int:
        """The number of sources that heat."""
        return 1 + sum(not source.cools for source in self._others)

    @property
    def cools(self) -> bool:
        """Whether there are other sources."""
        return self.heating <= len(self._others)

    @property
    def most_heat_w(self) -> FloatArray:
        """The most heat of all at any temperature, as HVCH power [W] (N,)."""
        return self._most_w[0]

    @property
    def most_cold_w(self) -> FloatArray:
        """The least heat of all at any temperature, as HVCH power [W] (N,), at most 0."""
        return self._most_w[1]

    @property
    def most_power_w(self) -> FloatArray:
        """The most electrical power for either at any temperature [W] (N,)."""
        return self._most_w[2]

    @cached_property
    def _sources(self) -> list[tuple[Any, ...]]:
        """Whether each source is open, the cabin's share of its power, its curves' functions, and its steps."""
        route, sources = self.route, []
        may_move = not self.vehicle.heating_gates.only_while_standing
        for source in self._others:
            is_open = source.serves_at(route.speed_mps) & (may_move | (route.speed_mps < STANDING_MPS))
            taken_w = route.cabin_heating_power_w if source.shares_cabin_limit else np.zeros(len(route))
            sources.append((is_open, taken_w, source.maximum_power_w.function(ARRAYS),
                            source.hvch_watts.function(ARRAYS), source.power_steps_w))
        return sources

    @cached_property
    def _most_w(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        steps = len(self.route)
        grid_c = np.arange(*self.vehicle.battery.temperature_range_c, FIRST_STEP_K)
        heats_w, powers_w = self._each(np.repeat(np.arange(steps), len(grid_c)), np.tile(grid_c, steps))
        of_all = heats_w, powers_w, -heats_w, powers_w
        most_w, warm_w, cold_w, cool_w = (
            rows_w[part].sum(axis=0).reshape(steps, -1).max(axis=1) for rows_w, part in zip(
                of_all, [slice(self.heating)] * 2 + [slice(self.heating, None)] * 2))
        return most_w, -cold_w, np.maximum(warm_w, cool_w)

    def _each(self, k: AnyNumber, temperature_c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return most heat and electrical power [W] (S, P) of the sources in steps and at temperatures (P,)."""
        shape, ambient_c = temperature_c.shape, self.route.ambient_temperature_c[k]
        powers_w, hvch_watts = [np.broadcast_to(self.hvch_limit_w[k], shape)], [np.ones(shape)]
        for is_open, taken_w, most_w, watts, steps_w in self._sources:
            power_w = is_open[k] * np.maximum(most_w(ambient_c, temperature_c) - taken_w[k], 0.0)
            if steps_w:
                power_w = steps_below_w(steps_w, power_w + ROUNDING_W)
            powers_w.append(np.broadcast_to(power_w, shape))
            hvch_watts.append(np.broadcast_to(watts(ambient_c, temperature_c), shape))
        return np.array(powers_w) * np.array(hvch_watts), np.array(powers_w)

    def _ordered(self, k: AnyNumber, temperature_c: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return heat and power of `_each` in the order of merit, and that order, (S, P) each."""
        heats_w, powers_w = self._each(k, temperature_c)
        merit = np.abs(heats_w) / np.maximum(powers_w, 1e-9)
        first = self.heating
        order = np.concatenate([np.argsort(-merit[:first], axis=0, kind='stable'),
                                first + np.argsort(-merit[first:], axis=0, kind='stable')])
        return np.take_along_axis(heats_w, order, 0), np.take_along_axis(powers_w, order, 0), order

    def at(self, k: int, temperature_c: AnyNumber) -> Sources:
        """Return the Sources in step k at battery temperatures [deg C]: a float, or an array (P,)."""
        if not isinstance(temperature_c, np.ndarray):
            heats_w, powers_w, _ = self._ordered(k, np.array([float(temperature_c)]))
            return Sources(heats_w[:, 0].tolist(), powers_w[:, 0].tolist(), self.heating)
        heats_w, powers_w, _ = self._ordered(k, temperature_c)
        return Sources(list(heats_w), list(powers_w), self.heating)

    def split_w(self, heat_w: FloatArray, temperature_c: FloatArray) -> dict[str, FloatArray]:
        """Return the electrical power (N,) of each source for heat (N,) at the temperatures of the starts (N,)."""
        heats_w, powers_w, order = self._ordered(np.arange(len(heat_w)), temperature_c)
        split_w = np.zeros(powers_w.shape)
        np.put_along_axis(split_w, order, np.array([
            share * power_w for (_, share), power_w in zip(parts(heat_w, list(heats_w)), powers_w)]) + 0.0, 0)
        return dict(zip(self.names, split_w))

    def by_merit(self, temperature_c: float) -> dict[str, tuple[float, float]]:
        """Return most heat and power [W] of each source in the first step at a temperature [deg C], by merit."""
        heats_w, powers_w, order = (each[:, 0].tolist() for each in self._ordered(0, np.array([temperature_c])))
        return {self.names[number]: (heat_w, power_w) for heat_w, power_w, number in zip(heats_w, powers_w, order)}

    def for_core(self) -> tuple[FloatArray, ...]:
        """Return the arrays of a `bev_heat_sources`."""
        # The temperatures between which all curves are straight, two at least.
        axis_c = sorted({point_c for source in self.vehicle.heat_sources for curve in (
            source.maximum_power_w, source.hvch_watts) for point_c in getattr(curve, 'temperature_c', (0.0,))})
        axis_c = sorted({*axis_c, *(axis_c[0] + more_k for more_k in (0.0, 1.0))})
        temperature_c, steps = np.array(axis_c), len(self.hvch_limit_w)
        ambient_c = np.repeat(self.route.ambient_temperature_c, len(axis_c))
        power_w, watts, taken_w = [np.repeat(self.hvch_limit_w, len(axis_c))], [np.ones(len(ambient_c))], [
            np.zeros(steps)]
        most_steps = max([1, *(len(source.power_steps_w) for source in self._others)])
        steps_w = np.full((1 + len(self._others), most_steps), np.inf)
        for number, (is_open, cabin_w, most_w, hvch_watts, own_w) in enumerate(self._sources, 1):
            steps_w[number, :len(own_w)] = own_w
            for rows, curve in (power_w, most_w), (watts, hvch_watts):
                rows.append(np.broadcast_to(curve(ambient_c, np.tile(temperature_c, steps)), ambient_c.shape))
            taken_w.append(np.where(is_open, cabin_w, np.inf))
        by_source = (np.stack(rows, axis=-1).reshape(steps, len(axis_c), -1) for rows in (power_w, watts))
        return temperature_c, *by_source, np.stack(taken_w, axis=-1), steps_w, self.most_power_w, self.most_cold_w


@lru_cache(maxsize=KEPT_SEGMENTS)
def mix_in_segment(vehicle: Vehicle, route: Route, segment: int, hvch_limit_w: float) -> HeatMix:
    """Return the HeatMix of one segment of a route as its first step, with the power of the HVCH [W]."""
    return HeatMix(vehicle, route.segments(segment, segment + 1), np.array([hvch_limit_w]))
