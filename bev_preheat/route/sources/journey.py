# SPDX-License-Identifier: Apache-2.0
"""The contents of a route's source before a car drives it: points or pieces of road, and its stops to charge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from bev_preheat.errors import figure, InvalidInput
from bev_preheat.numerics import EARTH_RADIUS_M, first_true, FloatArray
from bev_preheat.route.line import RouteLine
from bev_preheat.route.road_load import Motion
from bev_preheat.route.segments import LIMITS, LONGEST_ROUTE_S
from bev_preheat.route.sources.elevation import smooth_elevation

# Duration [s] of the segments that samples are joined to.
SEGMENT_S = 30.0
# Slopes of roads for cars, rise over run.
SLOPE_RANGE = (-0.4, 0.4)
# Durations of charging stops [s].
STOP_RANGE_S = (1.0, 86400.0)


@dataclass(frozen=True)
class ChargingStop:
    """A charging stop after a segment (index), with its duration [s]."""

    after_segment: int
    duration_s: float


@dataclass(frozen=True)
class Journey:
    """
    The Motion along a route, and further figures of its source, each of shape (N,) or None if unknown.

    `consumption_wh` is the electrical energy of each segment; it replaces the road load. `remarks` are
    sentences on assumptions and repairs; `line` is the route on the map; `sampled`: the speeds are
    samples, so their segments are joined to longer ones. `stops` are the charging stops.
    """

    kind: str
    motion: Motion
    ambient_temperature_c: FloatArray | None = None
    consumption_wh: FloatArray | None = None
    cabin_heating_power_w: FloatArray | None = None
    auxiliary_power_w: FloatArray | None = None
    line: RouteLine | None = None
    stops: tuple[ChargingStop, ...] = ()
    remarks: tuple[str, ...] = ()
    sampled: bool = False


class Offers(NamedTuple):
    """
    The figures of RouteOptions that a caller takes, for messages.

    `form` joins name and value; `figures` has the name, the unit and examples of each: (name, unit, *examples).
    """

    form: str
    figures: Mapping[str, tuple[Any, ...]]


NO_OFFERS = Offers('', {})


@dataclass(frozen=True)
class RouteOptions:
    """
    Figures that may be missing in a source.

    `ambient_temperature_c` [degC] applies if the file has none. `with_auxiliaries`: the consumption in the file
    includes heating and auxiliaries (None: not given). `free_speed_kmh` [km/h]: speed on free road, for a line
    without times. `stop_duration_s` [s]: duration of a charging stop at each waypoint (None: waypoints are
    passed). `vehicle_id`: the vehicle in a file with several. `offers` are those that the caller takes.
    """

    ambient_temperature_c: float | None = None
    with_auxiliaries: bool | None = None
    free_speed_kmh: float | None = None
    stop_duration_s: float | None = None
    vehicle_id: str | None = None
    offers: Offers = field(default=NO_OFFERS, compare=False)

    def advice(self, figure: str, request: str, *values: object) -> str:
        """Return the request for a missing figure in the caller's words; another way if it does not take it."""
        if figure not in self.offers.figures:
            return 'make a route file with preheat route --from'
        name, unit, *examples = self.offers.figures[figure]
        given = [self.offers.form.format(name, value) for value in values or examples]
        such = '' if len(given) > 1 else ', such as'
        return f'{request}{f" [{unit}]" if unit else ""}{such}: {" or ".join(given)}'

    def name(self, figure: str) -> str:
        """Return the caller's name of a figure that is given."""
        return str(self.offers.figures.get(figure, (figure,))[0])


# What scenarios and itineraries take.
BESIDE_ROUTE = Offers('{}: {} beside route', {'ambient_temperature_c': ('ambient_temperature_c', 'degC', -5)})

# Shorter segments, beside a stop, are joined with their neighbours [s].
LEAST_SEGMENT_S = 1.0
# Slower than this [m/s] over a whole segment is a standstill: position errors also move a parked car.
STANDSTILL_MPS = 0.3


@dataclass(frozen=True)
class Timeline:
    """
    M points along a road: `distance_m` and `elapsed_s`, shapes (M,), from 0 and never falling.

    `latitude_deg`, `longitude_deg` and `elevation_m` have shape (M,) or are None. `stops` are (instant [s],
    duration [s]) of charging stops; `elapsed_s` leaves their durations out. `breaks_s` are instants that no
    segment crosses.
    """

    distance_m: FloatArray
    elapsed_s: FloatArray
    latitude_deg: FloatArray | None = None
    longitude_deg: FloatArray | None = None
    elevation_m: FloatArray | None = None
    stops: tuple[tuple[float, float], ...] = ()
    breaks_s: tuple[float, ...] = ()


def journey_of(kind: str, timeline: Timeline, remarks: Sequence[str] = ()) -> Journey:
    """Return the Journey of a Timeline, in segments of SEGMENT_S; raise InvalidInput if it is implausible."""
    remarks = list(remarks)
    distance_m, elapsed_s = timeline.distance_m, timeline.elapsed_s
    total_s, total_m = float(elapsed_s[-1]), float(distance_m[-1])
    if not 1.0 <= total_s <= LONGEST_ROUTE_S:
        raise InvalidInput(f'the {kind} lasts {figure(total_s)} s; it must last 1 ... {LONGEST_ROUTE_S:g} s')
    if total_m < 10.0:
        raise InvalidInput(f'the {kind} is {figure(total_m, 3)} m long; at least 10 m are needed')
    edges_s = _edges(timeline)
    duration_s = np.diff(edges_s)
    along_m = interpolated(edges_s, elapsed_s, distance_m)
    speed_mps = np.diff(along_m) / duration_s
    most_mps = LIMITS['speed_mps'][1]
    at = int(speed_mps.argmax())
    if speed_mps[at] > most_mps:
        raise InvalidInput(f'the {kind} has {figure(float(speed_mps[at]))} m/s at min {edges_s[at] / 60.0:.1f}; '
                           f'at most {most_mps:g} m/s are allowed; check times and coordinates')
    # A standstill keeps its elevation; its jitter is not driven.
    speed_mps = np.where(speed_mps < STANDSTILL_MPS, 0.0, speed_mps)
    if timeline.elevation_m is not None and np.isfinite(timeline.elevation_m).any():
        smooth_m, remark = smooth_elevation(distance_m, timeline.elevation_m)
        remarks += [remark] if remark else []
        elevation_m = np.interp(along_m, distance_m, smooth_m)
    else:
        remarks.append('no elevation: a level road')
        elevation_m = np.zeros(len(edges_s))
    stops = tuple(ChargingStop(int(np.argmin(np.abs(edges_s - instant_s))) - 1, duration)
                  for instant_s, duration in timeline.stops)
    line = None
    if timeline.latitude_deg is not None and timeline.longitude_deg is not None:
        line = RouteLine(timeline.latitude_deg, timeline.longitude_deg, distance_m, elapsed_s)
    return Journey(kind, Motion(duration_s, speed_mps, elevation_m), line=line, stops=stops,
                   remarks=tuple(remarks))


def _edges(timeline: Timeline) -> FloatArray:
    """Return the instants [s] between segments: every SEGMENT_S, and at breaks and stops."""
    end_s = float(timeline.elapsed_s[-1])
    fixed = sorted({0.0, end_s, *(instant_s for instant_s, _ in timeline.stops),
                    *(instant_s for instant_s in timeline.breaks_s if 0.0 < instant_s < end_s)})
    kept = [fixed[0]]
    stops = {instant_s for instant_s, _ in timeline.stops} | {end_s}
    for instant_s in fixed[1:]:
        if instant_s - kept[-1] < LEAST_SEGMENT_S:
            if instant_s in stops and len(kept) > 1:
                kept[-1] = instant_s
            continue
        kept.append(instant_s)
    kept[-1] = end_s
    pieces = [np.linspace(start_s, until_s, max(1, round((until_s - start_s) / SEGMENT_S)) + 1)[:-1]
              for start_s, until_s in zip(kept, kept[1:])]
    return np.concatenate((*pieces, [end_s]))


def interpolated(at: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return y at `at`, linear between points; where x repeats, y of its last point counts."""
    last = np.append(np.diff(x) > 0.0, True)
    values: FloatArray = np.interp(at, x[last], y[last])
    return values


def distances_m(latitude_deg: FloatArray, longitude_deg: FloatArray) -> FloatArray:
    """Return the distances [m] between neighbours of M points, shape (M - 1,), by the haversine formula."""
    latitude, longitude = np.radians(latitude_deg), np.radians(longitude_deg)
    half = (np.sin(0.5 * np.diff(latitude))**2 + np.cos(latitude[:-1]) * np.cos(latitude[1:])
            * np.sin(0.5 * np.diff(longitude))**2)
    apart_m: FloatArray = 2.0 * EARTH_RADIUS_M * np.arcsin(np.sqrt(np.clip(half, 0.0, 1.0)))
    return apart_m


def check_coordinates(latitude_deg: FloatArray, longitude_deg: FloatArray, element: str = 'point') -> None:
    """Raise InvalidInput naming the first of M points whose coordinates are not on the earth."""
    if len(latitude_deg) < 2:
        raise InvalidInput(f'has {len(latitude_deg)} {element}s; a route needs at least 2')
    for name, values, most in (('latitude', latitude_deg, 90.0), ('longitude', longitude_deg, 180.0)):
        if (at := first_true(~(np.abs(values) <= most))) is not None:
            raise InvalidInput(f'{element} {at + 1}: {name}: {figure(float(values[at]))} is not allowed; it must '
                               f'be {-most:g} ... {most:g} degrees')


# Lengths of a line and of its pieces may differ by this share, because they are rounded.
MOST_MISFIT = 0.2
# With more, the lengths are in another unit.
MOST_FACTOR = 50.0


@dataclass(frozen=True)
class Pieces:
    """A leg: lengths [m] and durations [s] of its N pieces, shapes (N,); charging at its end [s], or 0."""

    length_m: FloatArray
    duration_s: FloatArray
    stop_s: float = field(default=0.0, kw_only=True)

    def scaled_to(self, total_s: float) -> Pieces:
        """Return the leg with the durations scaled to a total [s]."""
        sum_s = float(self.duration_s.sum())
        return self if sum_s <= 0.0 else replace(self, duration_s=self.duration_s * (total_s / sum_s))


def journey_of_pieces(kind: str, legs: Sequence[Pieces], options: RouteOptions, remarks: Sequence[str] = (),
                      line: FloatArray | None = None,
                      elevation: tuple[FloatArray, FloatArray] | None = None) -> Journey:
    """
    Return the Journey of legs in driving order.

    `line`: latitudes, longitudes [deg] and elevations [m] (NaN: none) of the whole way, shape (3, M); `elevation`:
    distances [m] and elevations [m] of points along it, if the line has none. Waypoints between legs are charging
    stops if the leg or the options give a duration.
    """
    remarks = list(remarks)
    legs = [leg for leg in legs if leg.length_m.sum() > 0.0 or leg.duration_s.sum() > 0.0]
    if not legs:
        raise InvalidInput(f'the {kind} has no length')
    distance_m = np.concatenate(([0.0], np.cumsum(np.concatenate([leg.length_m for leg in legs]))))
    elapsed_s = np.concatenate(([0.0], np.cumsum(np.concatenate([leg.duration_s for leg in legs]))))
    ends = np.cumsum([len(leg.length_m) for leg in legs])[:-1]
    stops = tuple((float(elapsed_s[end]), duration_s) for end, duration_s in zip(
        ends, (leg.stop_s or options.stop_duration_s or 0.0 for leg in legs)) if duration_s > 0.0)
    passed = len(ends) - len(stops)
    if passed:
        remarks.append(f'{passed} waypoint{" is" if passed == 1 else "s are"} passed without a stop; '
                       + options.advice('stop_duration_s', 'for charging stops give their duration'))
    latitude_deg = longitude_deg = elevation_m = None
    if line is not None:
        latitude_deg, longitude_deg, height_m = line
        check_coordinates(latitude_deg, longitude_deg)
        along_m = np.concatenate(([0.0], np.cumsum(distances_m(latitude_deg, longitude_deg))))
        scaled_m = along_m * (distance_m[-1] / max(along_m[-1], 1e-9))
        if np.isfinite(height_m).all():
            elevation = scaled_m, height_m
        if not distance_m[-1] / MOST_FACTOR <= along_m[-1] <= MOST_FACTOR * distance_m[-1]:
            raise InvalidInput(f'the lengths of the {kind} add up to {distance_m[-1] / 1e3:.3g} km, its line on '
                               f'the map to {along_m[-1] / 1e3:.3g} km; ask the service for lengths in metres')
        if abs(along_m[-1] - distance_m[-1]) > MOST_MISFIT * distance_m[-1] + 50.0:
            remarks.append(f'the line on the map, {along_m[-1] / 1e3:.1f} km, does not fit the length of the way, '
                           f'{distance_m[-1] / 1e3:.1f} km; it is left out')
            latitude_deg = longitude_deg = None
        else:
            # All points of both: the pieces keep their durations, the line its shape.
            every_m = np.union1d(scaled_m, distance_m)
            elapsed_s, distance_m = np.interp(every_m, distance_m, elapsed_s), every_m
            latitude_deg, longitude_deg = (interpolated(every_m, scaled_m, values)
                                           for values in (latitude_deg, longitude_deg))
    if elevation is not None:
        at_m, values_m = elevation
        elevation_m = np.interp(distance_m, at_m, values_m)
    return journey_of(
        kind, Timeline(distance_m, elapsed_s, latitude_deg, longitude_deg, elevation_m, stops), remarks)
