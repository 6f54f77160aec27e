# SPDX-License-Identifier: Apache-2.0
"""
Shared by several messages: stamps, arrays, and numbers with a range.

Messages carry SI units and degrees Celsius, as the planner's values do; only energies are in Wh.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable
import math
from typing import NamedTuple

from builtin_interfaces.msg import Time
import numpy as np
from numpy.typing import ArrayLike

from bev_preheat.errors import quoted, range_problem
from bev_preheat.numerics import NS_PER_S

# The last second that a builtin_interfaces/Time can hold.
LAST_TIME_S = 2**31 - 1
# Repeated in every plan and log line.
LONGEST_ROUTE_ID = 256


def nanoseconds(stamp: Time) -> int:
    """Nanoseconds of a builtin_interfaces/Time."""
    return stamp.sec * NS_PER_S + stamp.nanosec


def seconds(stamp: Time) -> float:
    """Seconds of a builtin_interfaces/Time."""
    return nanoseconds(stamp) / NS_PER_S


def time_message(instant_ns: int) -> Time:
    """Return the builtin_interfaces/Time of an instant [ns]."""
    return Time(sec=instant_ns // NS_PER_S, nanosec=instant_ns % NS_PER_S)


def stamp_problems(stamp: Time) -> list[str]:
    """Return the problems of a header's stamp as sentences."""
    if stamp.sec == 0 and stamp.nanosec == 0:
        return ['header.stamp: is 0; it must be set, as "header: auto" of ros2 topic pub does']
    if stamp.nanosec >= NS_PER_S:
        return [f'header.stamp.nanosec: {stamp.nanosec} is not allowed; it must be below {NS_PER_S}']
    return []


def route_id_problems(route_id: str) -> list[str]:
    """Return the problems of a route_id as sentences."""
    return [] if len(route_id) <= LONGEST_ROUTE_ID else [
        f'route_id: {quoted(route_id)} is too long; it must have at most {LONGEST_ROUTE_ID} characters']


def doubles(values: ArrayLike) -> array[float]:
    """Return numbers as rclpy takes them without a copy of each."""
    return array('d', np.ascontiguousarray(values, dtype=float).tobytes())


def known(value: float) -> float | None:
    """Return a number, None if it is 0 or NaN: not given."""
    return None if value == 0.0 or math.isnan(value) else value


def highest_given(most_c: float) -> float:
    """Return the number of a message for a highest temperature [deg C]; 0 if it is inf, and never for 0 deg C."""
    return 0.0 if most_c == math.inf else most_c or math.nextafter(0.0, 1.0)


class Figure(NamedTuple):
    """
    The range and the unit of a number.

    `zero` and `nan` say what 0 and NaN mean, inside of the range or outside; '': nothing special.
    """

    low: float
    high: float
    unit: str = ''
    zero: str = ''
    nan: str = ''

    def problem(self, name: str, value: float) -> str:
        """Return a sentence on a value that is not allowed; '' if it is."""
        if (self.low <= value <= self.high or (self.zero and value == 0.0)
                or (self.nan and math.isnan(value))):
            return ''
        special = (f', or {"0 or " if self.zero else ""}NaN: {self.nan}' if self.nan else
                   f' (0: {self.zero})' if self.zero else '')
        return range_problem(name, value, self.low, self.high, self.unit, special)

    def problems(self, name: str, values: Iterable[float]) -> list[str]:
        """Return a sentence on the first element of an array that is not allowed; [] if all are."""
        for at, value in enumerate(values):
            if problem := self.problem(f'{name}[{at}]', value):
                return [problem]
        return []
