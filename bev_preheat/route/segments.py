# SPDX-License-Identifier: Apache-2.0
"""The route: segments of constant speed, power and ambient temperature; times [s] from the start of segment 0."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
import math
from typing import Self

import numpy as np

from bev_preheat.errors import figure_beyond, InvalidInput, range_problem
from bev_preheat.numerics import first_true, FloatArray, mean_magnitude
from bev_preheat.vehicle.description import Defaults

# Valid range of a segment's values: (low, high). Wide enough for a truck on a pass, narrow enough to
# detect wrong units: a speed in km/h, a power in kW squared, a temperature in kelvin.
LIMITS = {
    'duration_s': (1e-3, 86400.0),
    'speed_mps': (0.0, 100.0),
    'propulsion_power_w': (-2e6, 2e6),
    'propulsion_power_rms_w': (0.0, 2e6),
    'ambient_temperature_c': (-60.0, 60.0),
    'cabin_heating_power_w': (0.0, 50e3),
    'auxiliary_power_w': (0.0, 50e3),
    'propulsion_power_magnitude_w': (0.0, 2e6),
}
# Elevations of roads [m].
ELEVATION_RANGE_M = (-500.0, 9000.0)
# Longest route [s] and largest number of segments; more is refused.
LONGEST_ROUTE_S = 24 * 3600.0
MOST_SEGMENTS = 200_000
# The root mean square may be below the mean magnitude, and that below |mean|, by rounding only.
POWER_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class Route:
    """
    N segments in driving order; each field is a float array of shape (N,).

    Powers are electrical: `propulsion_power_w` is the drivetrain's mean including its losses
    (negative = regeneration), `propulsion_power_rms_w` its root mean square within the segment,
    `propulsion_power_magnitude_w` the mean of its magnitude there, which determines the heat of the
    drivetrain, `cabin_heating_power_w` the HVCH power for the cabin.
    """

    duration_s: FloatArray
    speed_mps: FloatArray
    propulsion_power_w: FloatArray
    propulsion_power_rms_w: FloatArray
    ambient_temperature_c: FloatArray
    cabin_heating_power_w: FloatArray
    auxiliary_power_w: FloatArray
    propulsion_power_magnitude_w: FloatArray

    def __repr__(self) -> str:
        """Return number of segments, duration, distance and ambient temperatures as one line."""
        coldest_c, warmest_c = self.ambient_temperature_c.min(), self.ambient_temperature_c.max()
        return (f'<Route: {len(self)} segments, {self.total_duration_s / 60.0:.1f} min, '
                f'{self.distance_m / 1e3:.1f} km, {coldest_c:.1f} ... {warmest_c:.1f} degC>')

    def __len__(self) -> int:
        return len(self.duration_s)

    @classmethod
    def _of_block(cls, block: FloatArray) -> Self:
        """Return the route of a `block`."""
        route = object.__new__(cls)
        # Built on each update of the planner: the constructor of a frozen class is three times slower.
        vars(route).update(zip(COLUMNS, block), block=block)
        return route

    @cached_property
    def block(self) -> FloatArray:
        """The fields in one block of memory, shape (8, N); read-only."""
        return np.array([getattr(self, name) for name in COLUMNS], dtype=float)

    @cached_property
    def time_s(self) -> FloatArray:
        """Instants at which segments start, and the end: shape (N + 1,); read-only."""
        time_s = np.zeros(len(self.duration_s) + 1)
        self.duration_s.cumsum(out=time_s[1:])
        time_s.flags.writeable = False
        return time_s

    @cached_property
    def lowest_ambient_temperature_c(self) -> float:
        """Lowest ambient temperature of all segments [deg C]."""
        return float(np.minimum.reduce(self.ambient_temperature_c))

    @cached_property
    def _lowest_ambient_from_c(self) -> list[float]:
        """Lowest ambient temperature of each segment and all later ones [deg C]."""
        lowest_c: list[float] = np.minimum.accumulate(self.ambient_temperature_c[::-1])[::-1].tolist()
        return lowest_c

    def segment_at(self, elapsed_s: float) -> int:
        """Return the index of the segment at an instant [s], clipped to the first and last segment."""
        return bisect_right(self._boundaries_s, elapsed_s)

    @cached_property
    def _boundaries_s(self) -> list[float]:
        """Instants between segments [s], as a list: searched five times faster than an array."""
        boundaries_s: list[float] = self.time_s[1:-1].tolist()
        return boundaries_s

    def with_propulsion(self, factor: float | FloatArray) -> Route:
        """Return the route with its propulsion powers times a factor: a number, or one a segment, shape (N,)."""
        magnitude = np.abs(factor)
        route = self._of_block(self.block.copy())
        vars(route)['lowest_ambient_temperature_c'] = self.lowest_ambient_temperature_c
        power_w, rms_w, magnitude_w = (
            route.propulsion_power_w, route.propulsion_power_rms_w, route.propulsion_power_magnitude_w)
        power_w *= factor
        rms_w *= magnitude
        magnitude_w *= magnitude
        return route

    def read_only(self) -> Route:
        """Return a copy of the route whose columns cannot be written to."""
        block = self.block.copy()
        block.flags.writeable = False
        return self._of_block(block)

    def without_variation(self) -> Route:
        """Return the route with a propulsion power that is constant within each segment."""
        constant_w = np.abs(self.propulsion_power_w)
        return replace(self, propulsion_power_rms_w=constant_w, propulsion_power_magnitude_w=constant_w)

    @cached_property
    def total_duration_s(self) -> float:
        """Duration of the whole route [s]."""
        # The same sum as time_s, because np.sum adds in another order and rounds differently.
        return float(self.time_s[-1])

    @property
    def distance_m(self) -> float:
        """Length of the whole route [m]."""
        return float(self.duration_s @ self.speed_mps)

    @property
    def propulsion_power_variance_w2(self) -> FloatArray:
        """Variance of the propulsion power within each segment [W^2], shape (N,)."""
        return np.maximum(self.propulsion_power_rms_w**2 - self.propulsion_power_w**2, 0.0)

    def after(self, instant_s: float) -> Route:
        """Return the route from an instant [s] on the route on; a partly driven segment keeps its remainder."""
        if not 0.0 <= instant_s < self.total_duration_s:
            raise ValueError(f'instant {instant_s} s is not on this route of {self.total_duration_s} s')
        first = self.segment_at(instant_s)
        route = self._of_block(self.block[:, first:].copy())
        route.duration_s[0] = self.time_s[first + 1] - instant_s
        vars(route)['lowest_ambient_temperature_c'] = self._lowest_ambient_from_c[first]
        return route

    def before(self, instant_s: float) -> Route:
        """Return the route up to an instant [s], above 0 and at most the end; the last segment may be cut."""
        if not 0.0 < instant_s <= self.total_duration_s:
            raise ValueError(f'instant {instant_s} s is not on this route of {self.total_duration_s} s')
        starts = self.time_s[:-1]
        end = int(np.searchsorted(starts, instant_s, side='left'))
        route = self.segments(0, end)
        route.duration_s[-1] = instant_s - starts[end - 1]
        return route

    def followed_by(self, other: Route) -> Route:
        """Return the route followed by another one."""
        return self._of_block(np.concatenate((self.block, other.block), axis=1))

    def segments(self, first: int, end: int) -> Route:
        """Return the segments from `first` up to, not including, `end`."""
        return self._of_block(self.block[:, first:end].copy())

    def divided(self, longest_s: float | FloatArray) -> Route:
        """Return the route with segments longer than `longest_s` ([s], or shape (N,)) in equal parts."""
        if (self.duration_s <= longest_s).all():
            return self
        parts = np.maximum(np.ceil(self.duration_s / longest_s - 1e-9).astype(int), 1)
        route = self._of_block(np.repeat(self.block, parts, axis=1))
        route.duration_s[:] = np.repeat(self.duration_s / parts, parts)
        return route

    def resampled(self, step_s: float) -> Route:
        """Return the route in steps [s], the last maybe shorter, with its energy, mean square and distance."""
        if not 0.0 < step_s < np.inf:
            raise ValueError(f'step {step_s} s must be above 0 and finite')
        old = self.time_s
        # A sliver at the end does not become a step.
        steps = max(1, int(np.ceil(old[-1] / step_s - 1e-9)))
        new = np.minimum(np.arange(steps + 1) * float(step_s), old[-1])
        new[-1] = old[-1]
        duration_s = np.diff(new)

        def mean(values: FloatArray) -> FloatArray:
            integral = np.concatenate(([0.0], np.cumsum(values * self.duration_s)))
            means: FloatArray = np.diff(np.interp(new, old, integral)) / duration_s
            return means

        power_w = mean(self.propulsion_power_w)
        mean_square_w2 = mean(self.propulsion_power_rms_w**2)
        return Route(
            duration_s=duration_s,
            speed_mps=mean(self.speed_mps),
            propulsion_power_w=power_w,
            propulsion_power_rms_w=np.sqrt(np.maximum(mean_square_w2, power_w**2)),
            propulsion_power_magnitude_w=mean(self.propulsion_power_magnitude_w),
            ambient_temperature_c=mean(self.ambient_temperature_c),
            cabin_heating_power_w=mean(self.cabin_heating_power_w),
            auxiliary_power_w=mean(self.auxiliary_power_w))


@dataclass(frozen=True, eq=False)
class Places:
    """
    Distance from the start [m] over planned time [s], linear between points; both from 0, shapes (M,).

    At a stop one distance has a span of time.
    """

    time_s: FloatArray
    distance_m: FloatArray

    @classmethod
    def of_route(cls, route: Route) -> Places:
        """Return the Places of a route."""
        return cls(route.time_s, np.concatenate(([0.0], np.cumsum(route.duration_s * route.speed_mps))))

    @classmethod
    def joined(cls, parts: Iterable[tuple[float, Places]]) -> Places:
        """Return the Places of several parts in a row: (start of each [s], its Places)."""
        times_s, distances_m, length_m = [], [], 0.0
        for start_s, places in parts:
            times_s.append(start_s + places.time_s)
            distances_m.append(length_m + places.distance_m)
            length_m += places.length_m
        return cls(np.concatenate(times_s), np.concatenate(distances_m))

    @property
    def length_m(self) -> float:
        """Distance from the start to the end [m]."""
        return float(self.distance_m[-1])

    def distance_at_m(self, time_s: float) -> float:
        """Return the distance [m] at a planned time [s]."""
        return float(np.interp(time_s, self.time_s, self.distance_m))

    def earliest_s(self, distance_m: float) -> float:
        """Return the first planned time [s] at or beyond a distance [m]; -inf at the start, else the end's."""
        at = int(np.searchsorted(self.distance_m, distance_m, side='left'))
        if at == 0:
            return -math.inf
        return self._between_s(at, distance_m) if at < len(self.time_s) else float(self.time_s[-1])

    def latest_s(self, distance_m: float) -> float:
        """Return the last planned time [s] at or before a distance [m]; inf at the end, else the start's."""
        at = int(np.searchsorted(self.distance_m, distance_m, side='right'))
        if at == len(self.time_s):
            return math.inf
        return self._between_s(at, distance_m) if at > 0 else float(self.time_s[0])

    def _between_s(self, at: int, distance_m: float) -> float:
        """Return the time of a distance between the points `at` - 1 and `at`, which differ."""
        before_m, after_m = self.distance_m[at - 1], self.distance_m[at]
        before_s, after_s = self.time_s[at - 1], self.time_s[at]
        share = (distance_m - before_m) / (after_m - before_m)
        return float(before_s + share * (after_s - before_s))


COLUMNS = tuple(field.name for field in fields(Route))
# Units, from the ends of the names.
UNITS = {name: {'s': 's', 'mps': 'm/s', 'c': 'degC', 'w': 'W'}[name.rpartition('_')[2]] for name in COLUMNS}


def make_route(columns: Mapping[str, Sequence[float] | FloatArray | None],
               defaults: Defaults | None, names: dict[str, str] | None = None,
               tells_units: bool = False) -> Route:
    """
    Check columns and return their Route.

    `columns` maps the fields of Route to arrays of N numbers or of 1 (the same in each segment).
    `propulsion_power_rms_w`, `propulsion_power_magnitude_w`, `cabin_heating_power_w` and
    `auxiliary_power_w` may be None or empty; the defaults are |mean|, the mean magnitude of a power
    that varies normally with that mean and rms, and the vehicle's `defaults` (vehicle.description.Defaults),
    which may be None if the last two are given. `names` maps fields to their names in the source,
    for the messages; `tells_units`: these names have no unit, so the messages add it.

    Raises InvalidInput with one problem per field.
    """
    names = names or {}
    arrays, problems = {}, []
    for field, limits in LIMITS.items():
        values = columns.get(field)
        if values is None or len(values) == 0:
            continue
        array = np.asarray(values, dtype=float)
        problem = problem_with_values(array, limits, UNITS[field] if tells_units else '')
        if problem:
            problems.append(f'{names.get(field, field)}{problem}')
        arrays[field] = array

    optional = ('propulsion_power_rms_w', 'propulsion_power_magnitude_w', 'cabin_heating_power_w',
                'auxiliary_power_w')
    missing = [names.get(field, field) for field in LIMITS if field not in arrays and field not in optional]
    if missing:
        problems.append(f'missing or empty: {", ".join(missing)}')
        raise InvalidInput(problems)
    count = max(map(len, arrays.values()))
    for field, array in arrays.items():
        if len(array) not in (1, count):
            problems.append(f'{names.get(field, field)}: has {len(array)} values; it must have 1 '
                            f'or {count}, the length of the longest array')
    if count > MOST_SEGMENTS:
        problems.append(f'has {count} segments; at most {MOST_SEGMENTS} are planned')
    if problems:
        raise InvalidInput(problems)

    arrays = {field: np.broadcast_to(array, count) for field, array in arrays.items()}
    for field in ('cabin_heating_power_w', 'auxiliary_power_w'):
        if field not in arrays:
            arrays[field] = np.full(count, getattr(defaults, field))
    _complete_powers(arrays, names)
    route = Route(**arrays)
    if route.total_duration_s > LONGEST_ROUTE_S:
        raise InvalidInput(f'{names.get("duration_s", "duration_s")}: the route lasts '
                           f'{figure_beyond(route.total_duration_s, 0.0, LONGEST_ROUTE_S)} s; at most '
                           f'{LONGEST_ROUTE_S:g} s are planned')
    return route


def _complete_powers(arrays: dict[str, FloatArray], names: dict[str, str]) -> None:
    """Fill in missing rms and mean magnitude of the power; |mean| <= magnitude <= rms."""
    mean_w = np.abs(arrays['propulsion_power_w'])
    rms_w = arrays.get('propulsion_power_rms_w', mean_w)
    _check_order(rms_w, mean_w, 'propulsion_power_rms_w', 'the magnitude of the mean', names)
    rms_w = arrays['propulsion_power_rms_w'] = np.maximum(rms_w, mean_w)
    name = 'propulsion_power_magnitude_w'
    if name in arrays:
        magnitude_w = arrays[name]
        _check_order(magnitude_w, mean_w, name, 'the magnitude of the mean', names)
        _check_order(rms_w, magnitude_w, 'propulsion_power_rms_w', 'the mean magnitude', names)
    else:
        magnitude_w = mean_magnitude(arrays['propulsion_power_w'], rms_w**2 - mean_w**2)
    arrays[name] = np.clip(magnitude_w, mean_w, rms_w)


def _check_order(large_w: FloatArray, small_w: FloatArray, name: str, than: str, names: dict[str, str]) -> None:
    """Raise InvalidInput if one power is below another by more than rounding."""
    if (at := first_true(large_w < small_w * (1.0 - POWER_ROUNDING))) is not None:
        raise InvalidInput(f'{names.get(name, name)}[{at}]: {large_w[at]:g} is below {than}, {small_w[at]:g}')


def problem_with_values(array: FloatArray, limits: tuple[float, float], unit: str = '') -> str | None:
    """Return the problem with a column's values, to be appended to its name, or None."""
    if array.ndim != 1:
        return f': has {array.ndim} dimensions; it must be a plain list'
    low, high = limits
    bad = ~((array >= low) & (array <= high))
    at, others = first_true(bad), int(bad.sum()) - 1
    if at is None:
        return None
    more = f' (and {others} more)' if others else ''
    return range_problem(f'[{at}]', float(array[at]), low, high, unit, more)
