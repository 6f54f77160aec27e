# SPDX-License-Identifier: Apache-2.0
"""Drawn situations of one vehicle with the plans of Python, for the runner of an export (check.c)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.planning import engine
from bev_preheat.planning.methods import is_best, leaves_enough, plan_by_values
from bev_preheat.planning.one_interval import SwitchPlan
from bev_preheat.planning.outcome import find_outcome, NoRegretCheck
from bev_preheat.planning.schedule import Schedule
from bev_preheat.planning.situation import BatteryState, Goal, reserve_soc
from bev_preheat.planning.trip import make_trip, Trip
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle.core_library import without_core
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.model import TRIP_COLUMNS

OK, LIMITED, BAD_INPUT = 0, 4, -3
# The methods of an export, in the order of their answers in a vector.
METHODS = ('optimal_switch', 'value_function')
# Maximum steps of an export. One trip in LONG_EVERY has that many steps, one in DAMAGED_EVERY a value that is not
# finite, and one in EMPTY_EVERY starts with so little charge; never the same trip.
LARGEST_TRIP = 360
LONG_EVERY, LONG_AT = 100, 10
DAMAGED_EVERY, DAMAGED_AT = 25, 24
EMPTY_EVERY, EMPTY_AT, EMPTY_SOC = 25, 7, (0.02, 0.1)
USUAL_STEPS = 60
# The share of trips with climbs and descents at the limits of a cold battery and beyond.
LIMITED_SHARE = 0.5
NOMINAL_V = 350.0
EXPECTED = 10
NOT_A_NUMBER = (math.nan, math.inf, -math.inf)


class Answer(NamedTuple):
    """
    The expected answer of one method: a status and, if it is OK, the values of the plan.

    `expected` are the instants of switching on and off [s], six energies [Wh], and temperature [deg C] and
    charge on arrival; NaN: no value. `is_exact`: the plan is made without the recursion of value_function, which
    may end on another plan that is as good.
    """

    status: int
    expected: tuple[float, ...] = EXPECTED * (math.nan,)
    is_exact: bool = True

    @property
    def heats(self) -> bool:
        """Whether the method plans heating."""
        return self.status == OK and not math.isnan(self.expected[0])


@dataclass(frozen=True)
class Vector:
    """Numbers as in check.c: `columns` of bev_trip, `situation` of bev_ecu_situation, answers of METHODS."""

    columns: tuple[list[float], ...]
    situation: tuple[float, ...]
    answers: tuple[Answer, ...]

    def lines(self) -> Iterator[str]:
        """Return the vector as lines of vectors.txt."""
        yield f'vector {len(self.columns[1])} {_words(self.situation)}'
        for answer in self.answers:
            yield f'{answer.status} {int(answer.is_exact)} {_words(answer.expected)}'
        yield from map(_words, self.columns)


def draw_vectors(vehicle: Vehicle, count: int, seed: int,
                 report: Callable[[], None] = lambda: None) -> list[Vector]:
    """Return `count` Vectors of a Vehicle, reproducible by the seed. `report` is called after each."""
    vectors = []
    with without_core():
        for number in range(count):
            vectors.append(draw_vector(vehicle, seed, number))
            report()
    return vectors


def draw_vector(vehicle: Vehicle, seed: int, number: int) -> Vector:
    """Return one Vector of a Vehicle; planned without the core if called without the core."""
    random = np.random.default_rng([seed, number])
    trip, state, goal = _drawn(vehicle, random, number)
    columns = tuple(trip.columns.column(name).tolist() for name in TRIP_COLUMNS)
    situation = (
        state.soc, state.temperature_c, state.heater_power_w, state.coolant_excess_k, goal.target_temperature_c,
        reserve_soc(vehicle, goal), vehicle.battery.soc_range[0])
    if number % DAMAGED_EVERY == DAMAGED_AT:
        column = columns[int(random.integers(len(columns)))]
        column[int(random.integers(len(column)))] = NOT_A_NUMBER[int(random.integers(3))]
        return Vector(columns, situation, len(METHODS) * (Answer(BAD_INPUT),))
    found = engine.plan_switch(trip, state, goal.target_temperature_c)
    is_switched = found.unheated_keeps_limits and found.keeps_limits and leaves_enough(trip, goal, found)
    return Vector(columns, situation, (
        _answer(trip, found.schedule if is_switched else None, True),
        _answer(trip, _by_values(trip, state, goal, found), is_best(trip, goal, found))))


def _by_values(trip: Trip, state: BatteryState, goal: Goal, found: SwitchPlan) -> Schedule | None:
    """Return the plan of the method value_function; None if the plan is worse than not heating."""
    guard = NoRegretCheck(trip, state, goal, found.unheated)
    if guard.unheated.empty_at_s is not None:
        return None
    schedule = plan_by_values(trip, state, goal, found)
    return schedule if guard.allows(schedule) else None


def _answer(trip: Trip, schedule: Schedule | None, is_exact: bool) -> Answer:
    """Return the expected answer of the C code for a Schedule of Python, or for no Schedule."""
    if schedule is None:
        return Answer(LIMITED)
    energy = find_outcome(trip, schedule).energy_wh
    return Answer(OK, (
        *_instants_s(trip, schedule), energy.joule, energy.drivetrain_heat, energy.hvch_heat, energy.leakage,
        energy.hvch_electric, energy.battery_total, float(schedule.temperature_c[-1]),
        float(schedule.soc[-1])), is_exact)


def _instants_s(trip: Trip, schedule: Schedule) -> tuple[float, float]:
    """
    Return when the heater is switched on and off [s]; NaN if it is not, or not before arrival.

    While the cabin takes all heater power, any instant of switching off is equivalent; the plan's own instant
    then depends on rounding, so the end of the actual heating is returned.
    """
    if schedule.heating_start_s is None or not schedule.heater_power_w.any():
        return math.nan, math.nan
    arrival_s = float(trip.time_s[-1])
    if trip.vehicle.heat_path.is_direct:
        return schedule.heating_start_s, math.nan
    off_s = arrival_s if schedule.heating_end_s is None else schedule.heating_end_s
    last = np.flatnonzero((trip.heater_limit_w > 0.0) & (trip.time_s[:-1] < off_s))[-1]
    end_s = min(off_s, float(trip.time_s[last + 1]))
    return schedule.heating_start_s, end_s if end_s < arrival_s else math.nan


def vectors_text(vectors: Sequence[Vector]) -> str:
    """Return vectors.txt."""
    lines = [line for vector in vectors for line in vector.lines()]
    return '\n'.join([*lines, f'end {len(vectors)}', ''])


def first_heated(vectors: Sequence[Vector]) -> Vector:
    """Return the first Vector that both methods heat, for the example; else the first that both plan."""
    planned = [vector for vector in vectors if all(answer.status == OK for answer in vector.answers)]
    if not planned:
        raise InvalidInput('--vectors: no situation that was drawn has a plan without active limits; '
                           'draw more, or with another --seed')
    return next((vector for vector in planned if all(answer.heats for answer in vector.answers)), planned[0])


def _drawn(vehicle: Vehicle, random: np.random.Generator,
           number: int) -> tuple[Trip, BatteryState, Goal]:
    """Return a trip of at most LARGEST_TRIP steps, a state and a goal; in many a limit is active."""
    steps = LARGEST_TRIP if number % LONG_EVERY == LONG_AT else int(random.integers(2, USUAL_STEPS + 1))
    lowest_c, highest_c = vehicle.battery.temperature_range_c
    # Driving takes a part of the battery in an hour, whatever its size.
    capacity_wh = vehicle.battery.capacity_ah * NOMINAL_V
    power_w = random.uniform(-0.01, 0.25, steps) * capacity_wh
    is_limited = random.random() < LIMITED_SHARE
    for _ in range(int(random.integers(1, 4)) if is_limited else 0):
        # A climb or a descent, at the limits of a cold battery and beyond.
        first, length = int(random.integers(0, steps)), int(random.integers(1, 2 + steps // 6))
        power_w[first:first + length] += random.uniform(-1.2, 1.5) * capacity_wh
    longest_s = min(200.0, 9000.0 / steps)
    coldest_c = max(lowest_c, -15.0)
    route = make_route({
        'duration_s': random.uniform(0.2, 1.0, steps) * longest_s,
        'speed_mps': random.uniform(0.0, 33.0, steps), 'propulsion_power_w': power_w,
        'propulsion_power_rms_w': np.abs(power_w) * random.uniform(1.0, 1.2),
        'ambient_temperature_c': random.uniform(coldest_c, coldest_c + 18.0, steps),
        'cabin_heating_power_w': random.choice((0.0, 0.25, 1.1), steps, p=(0.1, 0.85, 0.05))
        * vehicle.hvch.maximum_power_w,
        'auxiliary_power_w': [float(random.uniform(200.0, 900.0))]}, vehicle.defaults)
    start_c = float(random.uniform(coldest_c + 10.0, min(coldest_c + 27.0, highest_c)))
    late = not vehicle.heat_path.is_direct and random.random() < 0.5
    socs = EMPTY_SOC if number % EMPTY_EVERY == EMPTY_AT else (0.75 if is_limited else 0.4, 0.98)
    state = BatteryState(
        start_c, float(random.uniform(*socs)),
        float(random.uniform(0.0, 0.5)) * vehicle.hvch.maximum_power_w if late else 0.0,
        float(random.uniform(0.0, 6.0)) if late else 0.0)
    goal = Goal(float(random.uniform(start_c - 5.0, min(start_c + 15.0, highest_c))),
                float(random.choice([0.0, 0.2, 0.6])))
    return make_trip(vehicle, route), state, goal


def _words(numbers: Sequence[float]) -> str:
    return ' '.join(map(repr, numbers))
