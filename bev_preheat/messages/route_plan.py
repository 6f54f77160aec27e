# SPDX-License-Identifier: Apache-2.0
"""
RoutePlan: read as a Mission or its refusal, and written.

The requests at the end of a leg stand in one field of the message for the last leg, and, with the prefix
`stop_`, in one element of an array for the leg before each stop.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
import math
from typing import Any, NamedTuple

import numpy as np

from bev_preheat.charging.stop import Charger, CHARGER_RANGE_W, ChargingProspect, MOST_S, USUAL_DEPARTURE_SOC
from bev_preheat.control.events import RefusedRoute
from bev_preheat.control.inputs import Leg, Mission, with_stops
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.fields import (
    doubles,
    Figure,
    highest_given,
    known,
    LAST_TIME_S,
    LONGEST_ROUTE_ID,
    nanoseconds,
    route_id_problems,
    stamp_problems,
    time_message,
)
from bev_preheat.numerics import FloatArray, NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route.road_load import elevation_of_slope, Motion, propulsion_columns, road_load_of
from bev_preheat.route.segments import LIMITS, make_route, MOST_SEGMENTS, problem_with_values
from bev_preheat.route.sources.journey import SLOPE_RANGE
from bev_preheat.tunables import MOST_STOPS
from bev_preheat.vehicle.description import Defaults, Vehicle
from bev_preheat_msgs.msg import RoutePlan

# Arrays with one element for each segment, by the fields of Route.
ROUTE_FIELDS = {
    'duration_s': 'segment_duration',
    'speed_mps': 'speed',
    'propulsion_power_w': 'propulsion_power',
    'propulsion_power_rms_w': 'propulsion_power_rms',
    'ambient_temperature_c': 'ambient_temperature',
    'cabin_heating_power_w': 'cabin_heating_power',
    'auxiliary_power_w': 'auxiliary_power',
    'propulsion_power_magnitude_w': 'propulsion_power_magnitude',
}
SEGMENT_ARRAYS = (*ROUTE_FIELDS.values(), 'slope')
TARGET, HAS_TARGET = 'target_battery_temperature', 'has_target_battery_temperature'
NOT_KNOWN = 'not known'
# Requested at the end of the last leg, and at each stop; the target has rules of its own.
AT_THE_END = {
    'maximum_arrival_temperature': Figure(-60.0, 60.0, 'degC', zero='not given', nan='not given'),
    'minimum_arrival_soc': Figure(0.0, 1.0),
    'charger_power': Figure(*CHARGER_RANGE_W, 'W', zero=NOT_KNOWN, nan=NOT_KNOWN),
    'charging_probability': Figure(0.0, 1.0, zero='not given, it charges for certain'),
    'arrival_time_deviation': Figure(0.0, MOST_S, 's', zero='not given, exact'),
    'charging_known_before_arrival': Figure(0.0, MOST_S, 's', zero='known on arrival'),
}
USUAL_SOC = f'{USUAL_DEPARTURE_SOC:g}'
LAST = {**AT_THE_END, 'charging_departure_soc': Figure(
    0.0, 1.0, zero=f'{NOT_KNOWN}, {USUAL_SOC}', nan=f'{NOT_KNOWN}, {USUAL_SOC}')}
DURATION = 'stop_duration'
STOP = {
    DURATION: Figure(1.0, 86400.0, 's'),
    f'stop_{TARGET}': Figure(-60.0, 60.0, 'degC', nan="the planner's own default"),
    **{f'stop_{name}': each for name, each in AT_THE_END.items()},
    'departure_battery_temperature': Figure(-60.0, 60.0, 'degC', nan='that wanted on arrival'),
    'departure_soc': Figure(0.0, 1.0, nan=USUAL_SOC),
}
STOP_ARRAYS = ('stop_after_segment', *STOP, f'stop_{HAS_TARGET}')
GIVEN = 'given in the route plan'
# Fields of Route needed for the road load.
NEEDED = ('duration_s', 'speed_mps', 'ambient_temperature_c')


class _Stop(NamedTuple):
    """A stop after a segment (its index), its duration [s], the requests at its leg's end, and how it is left."""

    after_segment: int
    duration_s: float
    requests: dict[str, Any]
    departure: BatteryState


# Reading


def is_cancellation(message: RoutePlan) -> bool:
    """Return whether a RoutePlan cancels the trip: no charging planned, no segments, no stops."""
    return not message.charging_planned and not any(
        len(getattr(message, name)) for name in (*SEGMENT_ARRAYS, *STOP_ARRAYS))


def mission_from_message(message: RoutePlan, defaults: Defaults, planning_step_s: float,
                         vehicle: Vehicle | None = None) -> Mission:
    """
    Return the Mission of a RoutePlan, its legs in steps of `planning_step_s` seconds or longer.

    `defaults` (vehicle.description.Defaults) fill in fields that the message leaves open, the road load of
    `vehicle` the propulsion power. Raises InvalidInput with one problem per field.
    """
    problems = [f'{name}: has {len(getattr(message, name))} values; at most {MOST_SEGMENTS} segments are planned'
                for name in SEGMENT_ARRAYS if len(getattr(message, name)) > MOST_SEGMENTS]
    problems += route_id_problems(message.route_id)
    if problems:
        # Too large for further checks.
        raise InvalidInput(problems)
    problems = stamp_problems(message.header.stamp) + _problems_at_the_end(message)
    columns = {field: np.asarray(getattr(message, name), dtype=float) for field, name in ROUTE_FIELDS.items()}
    route, stops, power_source = None, [], GIVEN
    try:
        if vehicle is not None and not len(message.propulsion_power) and not problems:
            columns, power_source = _with_powers(message, columns, vehicle)
        route = make_route(columns, defaults, ROUTE_FIELDS, tells_units=True)
    except InvalidInput as error:
        problems += error.problems
    try:
        stops = _stops(message, None if route is None else len(route), defaults.target_battery_temperature_c)
    except InvalidInput as error:
        problems += error.problems
    if route is not None and (message.header.stamp.sec + route.total_duration_s
                              + sum(stop.duration_s for stop in stops) > LAST_TIME_S):
        problems.append(f'header.stamp: {message.header.stamp.sec} s is too late: the route '
                        'would end after the last instant that a stamp can hold')
    if problems or route is None:
        raise InvalidInput(problems)
    edges = [0, *(stop.after_segment + 1 for stop in stops), len(route)]
    last = _requests(message.charging_planned, message.charging_departure_soc, **{
        name: getattr(message, name) for name in (TARGET, HAS_TARGET, *AT_THE_END)})
    legs = [Leg(route.segments(first, end), nanoseconds(message.header.stamp), departure=departure,
                **requests).in_planning_steps(planning_step_s)
            for first, end, departure, requests in zip(
                edges, edges[1:], [None, *(stop.departure for stop in stops)],
                [*(stop.requests for stop in stops), last])]
    return Mission(message.route_id, with_stops(legs, [stop.duration_s for stop in stops]),
                   message.standing_time, power_source=power_source)


def _problems_at_the_end(message: RoutePlan) -> list[str]:
    """Return the problems of all fields that are single numbers, and of the slope."""
    problems = [each.problem(name, getattr(message, name)) for name, each in LAST.items()]
    if not 0.0 <= message.standing_time < math.inf:
        problems.append(f'standing_time: {message.standing_time:g} is not allowed; it must be '
                        'finite and at least 0 s (0: not known)')
    target_c = message.target_battery_temperature
    if message.has_target_battery_temperature and not math.isfinite(target_c):
        problems.append(f'{TARGET}: {target_c:g} is not allowed where {HAS_TARGET} is true; it must be finite')
    elif math.isinf(target_c):
        problems.append(f"{TARGET}: {target_c:g} is not allowed; it must be finite, or 0 or NaN: the planner's "
                        'own default')
    slope = np.asarray(message.slope, dtype=float)
    if len(slope) and (problem := problem_with_values(slope, SLOPE_RANGE)):
        problems.append(f'slope{problem} (rise over run)')
    return [problem for problem in problems if problem]


def _with_powers(message: RoutePlan, columns: dict[str, FloatArray],
                 vehicle: Vehicle) -> tuple[dict[str, FloatArray], str]:
    """
    Return the columns with the powers of the road load, for a message without any, and their source as text.

    Raises InvalidInput if other columns are wrong, if the vehicle has no road_load, or if rms or magnitude are
    given without the mean power.
    """
    given = [name for name in ('propulsion_power_rms', 'propulsion_power_magnitude')
             if len(getattr(message, name))]
    if given:
        raise InvalidInput(f'{" and ".join(given)}: given without propulsion_power; give all three, or none')
    if any(not len(columns[field]) for field in NEEDED):
        # make_route names all that is missing.
        return columns, ''
    try:
        road_load_of(vehicle)
    except InvalidInput as error:
        raise InvalidInput([f'propulsion_power: empty, and {problem}' for problem in error.problems]) from error
    slope, count = message.slope, max(len(message.slope), *map(len, columns.values()))
    if len(slope) not in (0, 1, count):
        raise InvalidInput(f'slope: has {len(slope)} values; it must have 1 or {count}, the length of the longest '
                           'array, or none')
    # Any power of that length: the other columns are checked before they are used.
    route = make_route({**columns, 'propulsion_power_w': np.zeros(count)}, vehicle.defaults, ROUTE_FIELDS,
                       tells_units=True)
    slopes = np.broadcast_to(np.asarray(slope if len(slope) else [0.0], dtype=float), count)
    motion = Motion(route.duration_s, route.speed_mps,
                    elevation_of_slope(route.duration_s, route.speed_mps, slopes))
    source = (f'computed from speeds{" and slopes" if len(slope) else " (no slope: level road)"} and the '
              f'road_load of vehicle {vehicle.name}; accelerations within the segments are estimated')
    return {**columns, **propulsion_columns(vehicle, motion, route.ambient_temperature_c)}, source


def _requests(charging_planned: bool, departure_soc: float, **values: float) -> dict[str, Any]:
    """Return the fields of a Leg from the requests at its end; `values` are valid and named as in RoutePlan."""
    target_c = values[TARGET]
    is_given = not math.isnan(target_c) and (target_c != 0.0 or values[HAS_TARGET])
    least_soc = values['minimum_arrival_soc']
    most_c = known(values['maximum_arrival_temperature'])
    return {'charging_planned': charging_planned, 'target_temperature_c': target_c if is_given else None,
            'maximum_arrival_temperature_c': math.inf if most_c is None else most_c,
            'minimum_arrival_soc': 0.0 if math.isnan(least_soc) else least_soc,
            'charger': charger_of(values['charger_power'], departure_soc),
            'prospect': ChargingProspect(known(values['charging_probability']) or 1.0,
                                         known(values['arrival_time_deviation']) or 0.0,
                                         known(values['charging_known_before_arrival']) or 0.0)}


def charger_of(power_w: float, departure_soc: float) -> Charger | None:
    """Return the Charger of two valid numbers; 0 and NaN: unknown."""
    known_w = known(power_w)
    return None if known_w is None else Charger(known_w, known(departure_soc))


def _stops(message: RoutePlan, segments: int | None, default_target_c: float) -> list[_Stop]:
    """
    Return the stops of a RoutePlan with `segments` segments (None: unknown), in driving order.

    `default_target_c` [deg C] is the target if the message names none. Raises InvalidInput with one problem per
    field.
    """
    after_segment = message.stop_after_segment
    arrays, count = {name: getattr(message, name) for name in STOP_ARRAYS}, len(after_segment)
    problems = [f'{name}: has {len(values)} values; at most {MOST_STOPS} stops are planned'
                for name, values in arrays.items() if len(values) > MOST_STOPS]
    if problems:
        raise InvalidInput(problems)
    # Instant and duration of the stop depend on the durations.
    problems = [f'{name}: has {len(values)} values; it must have {count}, as stop_after_segment has'
                + ('' if name == DURATION else ', or none')
                for name, values in arrays.items()
                if len(values) != count and (len(values) or name == DURATION)]
    problems += _order_problems(after_segment, segments)
    for name, each in STOP.items():
        problems += each.problems(name, arrays[name])
    targets_c = arrays[f'stop_{TARGET}']
    problems += [f'stop_{HAS_TARGET}[{at}]: is true; stop_{TARGET}[{at}] must then be a finite number'
                 for at, has_target in enumerate(arrays[f'stop_{HAS_TARGET}'])
                 if has_target and not (at < len(targets_c) and math.isfinite(targets_c[at]))][:1]
    if problems:
        raise InvalidInput(problems)
    return [_stop({name: values[at] if len(values) else False if name == f'stop_{HAS_TARGET}' else math.nan
                   for name, values in arrays.items()}, default_target_c) for at in range(count)]


def _stop(values: dict[str, Any], default_target_c: float) -> _Stop:
    requests = _requests(True, values['departure_soc'], **{
        name: values[f'stop_{name}'] for name in (TARGET, HAS_TARGET, *AT_THE_END)})
    departure_c, target_c = values['departure_battery_temperature'], requests['target_temperature_c']
    if math.isnan(departure_c):
        departure_c = default_target_c if target_c is None else target_c
    return _Stop(values['stop_after_segment'], values[DURATION], requests,
                 BatteryState(departure_c, known(values['departure_soc']) or USUAL_DEPARTURE_SOC))


def _order_problems(after_segment: Sequence[int], segments: int | None) -> list[str]:
    """Return the first problem of the stops' order; `segments` is None if unknown."""
    for at, (before, segment) in enumerate(zip((-1, *after_segment), after_segment)):
        where = f'stop_after_segment[{at}]: {segment} is not allowed'
        if segment <= before:
            return [f'{where}; it must be above {before}, the one before it']
        if segments == 1:
            return [f'{where}; a route of one segment has no stop on the way']
        if segments is not None and segment > segments - 2:
            return [f'{where}; it must be below {segments - 1}, the last segment of the route']
    return []


def refused_route_of(message: RoutePlan) -> RefusedRoute:
    """Return the RefusedRoute of a RoutePlan; untrustworthy fields count as unreadable."""
    return RefusedRoute(message.route_id[:LONGEST_ROUTE_ID + 1], message.charging_planned,
                        _arrivals_ns(message))


def _arrivals_ns(message: RoutePlan) -> tuple[int, ...] | None:
    """Return the instants [ns] at which the legs of a RoutePlan end, None if unreadable."""
    stamp, durations_s = message.header.stamp, message.segment_duration
    after_segment, stops_s = message.stop_after_segment, message.stop_duration
    lengths = {len(getattr(message, name)) for name in ROUTE_FIELDS.values()} - {0}
    count = max(lengths, default=0)
    # If the lengths of the arrays differ, the durations may be wrong.
    if (not len(durations_s) or count > MOST_SEGMENTS or (len(durations_s) != count and lengths != {1, count})
            or nanoseconds(stamp) <= 0 or stamp_problems(stamp)
            or problem_with_values(np.asarray(durations_s, dtype=float), LIMITS['duration_s'])
            or len(after_segment) > MOST_STOPS or len(stops_s) != len(after_segment)
            or _order_problems(after_segment, count) or STOP[DURATION].problems(DURATION, stops_s)):
        return None
    ends_s = np.cumsum(np.broadcast_to(np.asarray(durations_s, dtype=float), count))
    arrivals_s = ends_s[[*after_segment, count - 1]]
    # Earlier stops delay the end of a leg.
    stood_s = np.concatenate(([0.0], np.cumsum(np.asarray(stops_s, dtype=float))))
    return tuple(nanoseconds(stamp) + round(float(instant_s) * NS_PER_S) for instant_s in arrivals_s + stood_s)


# Writing


def route_plan_message(mission: Mission) -> RoutePlan:
    """Return the RoutePlan of a Mission."""
    message = RoutePlan(route_id=mission.route_id, standing_time=mission.standing_time_s)
    message.header.stamp = time_message(mission.start_ns)
    for field, name in ROUTE_FIELDS.items():
        setattr(message, name, doubles(np.concatenate([getattr(leg.route, field) for leg in mission.legs])))
    legs, last = mission.legs, mission.legs[-1]
    for name, value in _request_fields(last).items():
        setattr(message, name, value)
    message.charging_planned = last.charging_planned
    message.charging_departure_soc = (last.charger.departure_soc or 0.0) if last.charger else 0.0
    stops = [_stop_fields(leg, following) for leg, following in zip(legs, legs[1:])]
    for name in STOP_ARRAYS[1:]:
        setattr(message, name, [stop[name] for stop in stops])
    message.stop_after_segment = array('I', (
        np.cumsum([len(leg.route) for leg in legs[:-1]]) - 1).astype(np.uint32).tobytes())
    return message


def _request_fields(leg: Leg) -> dict[str, Any]:
    """Return the requests at the end of a Leg, named as in RoutePlan."""
    prospect = leg.prospect
    return {TARGET: leg.target_temperature_c or 0.0, HAS_TARGET: leg.target_temperature_c is not None,
            'minimum_arrival_soc': leg.minimum_arrival_soc, 'maximum_arrival_temperature':
            highest_given(leg.maximum_arrival_temperature_c),
            'charger_power': leg.charger.power_w if leg.charger else 0.0,
            'charging_probability': 0.0 if prospect.probability == 1.0 else prospect.probability,
            'arrival_time_deviation': prospect.arrival_deviation_s,
            'charging_known_before_arrival': prospect.known_before_arrival_s}


def _stop_fields(leg: Leg, following: Leg) -> dict[str, Any]:
    """Return the elements of the stop between two Legs, named as in RoutePlan."""
    departure = following.departure
    if departure is None:
        raise ValueError('a leg after a stop has no state at its departure')
    return {DURATION: leg.ended_for_s(following.start_ns), 'departure_soc': departure.soc,
            'departure_battery_temperature': departure.temperature_c,
            **{f'stop_{name}': value for name, value in _request_fields(leg).items()}}
