# SPDX-License-Identifier: Apache-2.0
"""The stops of a RoutePlan: its arrays of one element a stop, checked at the door, and written."""

from array import array
from dataclasses import dataclass
import math
from typing import Optional

from bev_preheat.control.settings import MOST_STOPS
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.situation import BatteryState

# Fields of RoutePlan beside stop_after_segment: (low, high), as the message states them.
LIMITS = {
    'stop_duration': (1.0, 86400.0),
    'stop_target_battery_temperature': (-60.0, 60.0),
    'stop_minimum_arrival_soc': (0.0, 1.0),
    'departure_battery_temperature': (-60.0, 60.0),
    'departure_soc': (0.0, 1.0),
}
# Of these a NaN has a meaning.
NAN_MEANS = {'stop_target_battery_temperature': "the planner's own default"}


@dataclass(frozen=True)
class Stop:
    """
    A fast-charging stop after a segment (its index), and how long it lasts [s].

    On arrival `target_temperature_c` [deg C] is wanted (None: the planner's default) and
    `minimum_arrival_soc` at least; `departure` is the battery's state when the stop ends.
    """

    after_segment: int
    duration_s: float
    target_temperature_c: Optional[float]
    minimum_arrival_soc: float
    departure: BatteryState


def stops_from_message(message, segments):
    """
    Return the Stops of a RoutePlan of so many segments, in driving order.

    `segments` is None where their number is not known. Raises InvalidInput with one problem a
    field.
    """
    count = len(message.stop_after_segment)
    if count > MOST_STOPS:
        raise InvalidInput(f'stop_after_segment: has {count} values; at most {MOST_STOPS} stops '
                           'are planned')
    problems = [f'{field}: has {len(getattr(message, field))} values; it must have {count}, as '
                'stop_after_segment has' for field in LIMITS
                if len(getattr(message, field)) != count]
    problems += _order_problems(message.stop_after_segment, segments)
    for field in LIMITS:
        problems += _value_problems(field, getattr(message, field))
    if problems:
        raise InvalidInput(problems)
    columns = (getattr(message, field) for field in ('stop_after_segment', *LIMITS))
    return tuple(
        Stop(after_segment, duration_s, None if math.isnan(target_c) else target_c, least_soc,
             BatteryState(departure_c, departure_soc))
        for after_segment, duration_s, target_c, least_soc, departure_c, departure_soc
        in zip(*columns))


def _order_problems(after_segment, segments):
    for at, (before, segment) in enumerate(zip((-1, *after_segment), after_segment)):
        if segment <= before:
            return [f'stop_after_segment[{at}]: {segment} is not allowed; it must be above '
                    f'{before}, the one before it']
        if segments is not None and segment > segments - 2:
            return [f'stop_after_segment[{at}]: {segment} is not allowed; it must be below '
                    f'{segments - 1}, the last segment of the route']
    return []


def _value_problems(field, values):
    low, high = LIMITS[field]
    unknown = f', or NaN: {NAN_MEANS[field]}' if field in NAN_MEANS else ''
    # One problem tells enough, and there may be more values than stops.
    for at, value in enumerate(values):
        if not (low <= value <= high or unknown and math.isnan(value)):
            return [f'{field}[{at}]: {value:g} is not allowed; it must be {low:g} ... {high:g}'
                    f'{unknown}']
    return []


def write_stops(message, legs):
    """Write the stops between the Legs of a Mission into its RoutePlan."""
    after_segment, columns = array('I'), {field: array('d') for field in LIMITS}
    driven = 0
    for leg, following in zip(legs, legs[1:]):
        driven += len(leg.route)
        after_segment.append(driven - 1)
        target_c = leg.target_temperature_c
        for field, value in zip(LIMITS, (
                leg.ended_for_s(following.start_ns),
                math.nan if target_c is None else target_c,
                leg.minimum_arrival_soc,
                following.departure.temperature_c,
                following.departure.soc)):
            columns[field].append(value)
    message.stop_after_segment = after_segment
    for field, values in columns.items():
        setattr(message, field, values)
