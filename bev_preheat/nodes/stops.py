# SPDX-License-Identifier: Apache-2.0
"""The stops of a RoutePlan: its arrays with one element per stop, validated, read and written."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

from bev_preheat.charging.prospect import CERTAIN, ChargingProspect, MOST_S
from bev_preheat.charging.stop import Charger, CHARGER_RANGE_W, USUAL_DEPARTURE_SOC
from bev_preheat.control.settings import MOST_STOPS
from bev_preheat.errors import figure, figure_beyond, InvalidInput
from bev_preheat.planning.situation import BatteryState

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from bev_preheat.control.inputs import Leg
    from bev_preheat_msgs.msg import RoutePlan

NOT_KNOWN = 'not known'
# Fields of RoutePlan except stop_after_segment: (low, high), as in the message definition.
LIMITS = {
    'stop_duration': (1.0, 86400.0),
    'stop_target_battery_temperature': (-60.0, 60.0),
    'stop_minimum_arrival_soc': (0.0, 1.0),
    'stop_charger_power': CHARGER_RANGE_W,
    'departure_battery_temperature': (-60.0, 60.0),
    'departure_soc': (0.0, 1.0),
    'stop_charging_probability': (0.0, 1.0),
    'stop_arrival_time_deviation': (0.0, MOST_S),
    'stop_charging_known_before_arrival': (0.0, MOST_S),
}
TIMES = 'stop_duration', 'stop_arrival_time_deviation', 'stop_charging_known_before_arrival'
UNITS = {'stop_charger_power': 'W', **dict.fromkeys(TIMES, 's'),
         **dict.fromkeys(('stop_target_battery_temperature', 'departure_battery_temperature'), 'degC')}
# NaN has a meaning in these fields.
NAN_MEANS = {
    'stop_target_battery_temperature': "the planner's own default",
    'departure_battery_temperature': 'that wanted on arrival',
    'departure_soc': f'{USUAL_DEPARTURE_SOC:g}',
    'stop_charger_power': NOT_KNOWN,
}
# 0 has a meaning in these fields, outside of the range.
ZERO_MEANS = {'stop_charger_power': NOT_KNOWN}
HAS_TARGET = 'stop_has_target_battery_temperature'
# Required: instant and duration of the stop depend on these.
REQUIRED = ('stop_duration',)
STOP_FIELDS = ('stop_after_segment', *LIMITS, HAS_TARGET)


@dataclass(frozen=True)
class PlannedStop:
    """
    A fast-charging stop after a segment (its index), and its duration [s].

    Requested on arrival: `target_temperature_c` [deg C] (None: the planner's default) and at least
    `minimum_arrival_soc`; `departure` is the battery's state at the end of the stop. `charger` None: unknown.
    `prospect` is the ChargingProspect on arrival.
    """

    after_segment: int
    duration_s: float
    target_temperature_c: float | None
    minimum_arrival_soc: float
    departure: BatteryState
    charger: Charger | None = None
    prospect: ChargingProspect = CERTAIN


def stops_from_message(message: RoutePlan, segments: int | None,
                       default_target_c: float) -> tuple[PlannedStop, ...]:
    """
    Return the stops of a RoutePlan with `segments` segments, in driving order.

    `segments` is None if their number is unknown; `default_target_c` [deg C] is the target if the message names
    none. Raises InvalidInput with one problem per field.
    """
    count = len(message.stop_after_segment)
    problems = [f'{field}: has {len(getattr(message, field))} values; at most {MOST_STOPS} stops '
                'are planned'
                for field in STOP_FIELDS if len(getattr(message, field)) > MOST_STOPS]
    if problems:
        raise InvalidInput(problems)
    problems = [_length_problem(field, len(getattr(message, field)), count)
                for field in (*LIMITS, HAS_TARGET)
                if len(getattr(message, field)) != count
                and (field in REQUIRED or len(getattr(message, field)) > 0)]
    problems += order_problems(message.stop_after_segment, segments)
    for field in LIMITS:
        problems += value_problems(field, getattr(message, field))
    problems += _flag_problems(message)
    if problems:
        raise InvalidInput(problems)
    return tuple(_stop(message, at, default_target_c) for at in range(count))


def _stop(message: RoutePlan, at: int, default_target_c: float) -> PlannedStop:
    """Return a PlannedStop of a valid message."""
    def value(field: str) -> float:
        """Return an element; NaN if the array is empty."""
        values = getattr(message, field)
        return values[at] if len(values) else math.nan

    wanted_c = value('stop_target_battery_temperature')
    has_target = any(getattr(message, HAS_TARGET)[at:at + 1])
    is_given = not math.isnan(wanted_c) and (wanted_c != 0.0 or has_target)
    target_c = wanted_c if is_given else None
    least_soc = value('stop_minimum_arrival_soc')
    departure_c, departure_soc = value('departure_battery_temperature'), value('departure_soc')
    if math.isnan(departure_c):
        departure_c = default_target_c if target_c is None else target_c
    charger = charger_of(value('stop_charger_power'), departure_soc)
    if math.isnan(departure_soc) or departure_soc == 0.0:
        departure_soc = USUAL_DEPARTURE_SOC
    return PlannedStop(message.stop_after_segment[at], message.stop_duration[at], target_c,
                       0.0 if math.isnan(least_soc) else least_soc,
                       BatteryState(departure_c, departure_soc), charger, prospect_of(*map(value, (
                           'stop_charging_probability', 'stop_arrival_time_deviation',
                           'stop_charging_known_before_arrival'))))


def prospect_of(probability: float, deviation_s: float, known_before_s: float) -> ChargingProspect:
    """Return the ChargingProspect of three valid numbers; 0, and NaN of an empty array: not given."""
    def given(value: float, else_: float) -> float:
        return else_ if value == 0.0 or math.isnan(value) else value

    return ChargingProspect(given(probability, 1.0), given(deviation_s, 0.0), given(known_before_s, 0.0))


def charger_of(power_w: float, departure_soc: float) -> Charger | None:
    """Return the Charger of two valid numbers; 0 and NaN: unknown."""
    if power_w == 0.0 or math.isnan(power_w):
        return None
    is_known = departure_soc != 0.0 and not math.isnan(departure_soc)
    return Charger(power_w, departure_soc if is_known else None)


def _length_problem(field: str, length: int, count: int) -> str:
    empty = '' if field in REQUIRED else ', or none'
    return f'{field}: has {length} values; it must have {count}, as stop_after_segment has{empty}'


def order_problems(after_segment: Sequence[int], segments: int | None) -> list[str]:
    """Return the problems of the stops' order; `segments` is None if unknown."""
    for at, (before, segment) in enumerate(zip((-1, *after_segment), after_segment)):
        if segment <= before:
            return [f'stop_after_segment[{at}]: {segment} is not allowed; it must be above '
                    f'{before}, the one before it']
        if segments == 1:
            return [f'stop_after_segment[{at}]: {segment} is not allowed; a route of one segment has no stop '
                    'on the way']
        if segments is not None and segment > segments - 2:
            return [f'stop_after_segment[{at}]: {segment} is not allowed; it must be below '
                    f'{segments - 1}, the last segment of the route']
    return []


def value_problems(field: str, values: Iterable[float]) -> list[str]:
    """Return the problems of the values of a field of LIMITS."""
    low, high = LIMITS[field]
    zero, nan = ZERO_MEANS.get(field), NAN_MEANS.get(field)
    unknown = '' if nan is None else f', or {"NaN" if zero is None else "0 or NaN"}: {nan}'
    # One problem is enough.
    for at, value in enumerate(values):
        if not (low <= value <= high or (zero is not None and value == 0.0)
                or (nan is not None and math.isnan(value))):
            return [f'{field}[{at}]: {figure_beyond(value, low, high)} is not allowed; it must be '
                    f'{figure(low)} ... {figure(high)} {UNITS.get(field, "")}'.rstrip() + unknown]
    return []


def _flag_problems(message: RoutePlan) -> list[str]:
    """Return the problems of targets that are flagged as given but unset."""
    targets = message.stop_target_battery_temperature
    for at, has_target in enumerate(getattr(message, HAS_TARGET)):
        if has_target and not (at < len(targets) and math.isfinite(targets[at])):
            return [f'{HAS_TARGET}[{at}]: is true; stop_target_battery_temperature[{at}] must then '
                    'be a finite number']
    return []


def figures_of(prospect: ChargingProspect) -> tuple[float, float, float]:
    """Return a ChargingProspect as in a RoutePlan: probability, deviation [s], known before arrival [s]."""
    probability = 0.0 if prospect.probability == 1.0 else prospect.probability
    return probability, prospect.arrival_deviation_s, prospect.known_before_arrival_s


def write_stops(message: RoutePlan, legs: Sequence[Leg]) -> None:
    """Write the stops between the Legs of a Mission into its RoutePlan."""
    after_segment, columns = array('I'), {field: array('d') for field in LIMITS}
    driven, has_target = 0, []
    for leg, following in zip(legs, legs[1:]):
        departure = following.departure
        if departure is None:
            raise ValueError('a leg after a stop has no state at its departure')
        driven += len(leg.route)
        after_segment.append(driven - 1)
        has_target.append(leg.target_temperature_c is not None)
        for field, value in zip(LIMITS, (
                leg.ended_for_s(following.start_ns),
                leg.target_temperature_c or 0.0,
                leg.minimum_arrival_soc,
                leg.charger.power_w if leg.charger else 0.0,
                departure.temperature_c,
                departure.soc,
                *figures_of(leg.prospect))):
            columns[field].append(value)
    message.stop_after_segment = after_segment
    message.stop_has_target_battery_temperature = has_target
    for field, values in columns.items():
        setattr(message, field, values)
