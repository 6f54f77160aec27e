# SPDX-License-Identifier: Apache-2.0
"""Plans and runs within limits of the native core compared with Python's, and their refusals."""

from ctypes import addressof
from dataclasses import replace

import drawn_situations
import numpy as np
import pytest

from bev_preheat.planning.engine import trip_in_core
from bev_preheat.planning.trip import make_trip
from bev_preheat.vehicle.core_calls import vehicle_in_core
from bev_preheat.vehicle.core_library import core, LEFT
from bev_preheat.vehicle.core_structs import room, StrandingStruct, VALUE_KEPT_EVERY, ValueGoalStruct
from bev_preheat.vehicle.description import HeatPath
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

BAD_ARGUMENT, BAD_INPUT = -1, -3


def situation(number):
    """Return (trip, state, goal) in which limits matter, with a heat path if the number is odd."""
    drawn = draw_limit_trip(drawn_situations.car('reference'), 15, number)
    path = HeatPath(45.0, 16e3, 280.0) if number % 2 else HeatPath()
    return make_trip(replace(drawn.vehicle, heat_path=path), drawn.route), drawn.state, drawn.goal


def test_a_drive_within_limits_needs_each_argument():
    trip, state, _ = situation(4)
    steps = trip.columns.steps
    command_w, states, powers_w = trip.heater_limit_w.copy(), np.zeros((2, steps + 1)), np.zeros((2, steps))
    states[:, 0] = state.soc, state.temperature_c
    flags, stranding = np.empty(2 * steps, dtype=np.uint8), StrandingStruct()
    arguments = [vehicle_in_core(trip.vehicle).address, trip_in_core(trip).address, command_w.ctypes.data, np.inf,
                 True, *(array.ctypes.data for array in (states, powers_w, flags)), addressof(stranding)]
    assert core().bev_drive_as_planned(*arguments) == 0
    # All but two are pointers.
    for missing in {*range(len(arguments))} - {3, 4}:
        assert core().bev_drive_as_planned(
            *arguments[:missing], None, *arguments[missing + 1:]) == BAD_ARGUMENT, missing


def value_call(number, kept_every=1, deviation_k=0.0, room_of='BEV_VALUE_MEMORY'):
    """Return the arguments of bev_plan_by_values for a situation, and the arrays behind them."""
    trip, state, goal = situation(number)
    steps = trip.columns.steps
    asked = ValueGoalStruct(False, goal.target_temperature_c, np.inf, 0.0, deviation_k)
    states, powers_w = np.zeros((4, steps + 1)), np.zeros((4, steps))
    states[:2, 0] = state.soc, state.temperature_c
    flags = np.full(room('BEV_VALUE_BYTES', steps) + 64, 3, dtype=np.uint8)
    memory = np.full(room(room_of, steps) + 64, 7.25)
    ends_in = np.zeros(1, dtype=np.int32)
    return [vehicle_in_core(trip.vehicle).address, trip_in_core(trip).address, addressof(asked),
            *(array.ctypes.data for array in (states, powers_w, flags, memory, ends_in)), kept_every], (
                trip, asked, states, powers_w, flags, memory, ends_in)


@pytest.mark.parametrize('number', [4, 7], ids=['at once', 'late'])
@pytest.mark.parametrize('kept_every, room_of', [
    (1, 'BEV_VALUE_MEMORY'), (2, 'BEV_VALUE_MEMORY'), (10**6, 'BEV_VALUE_MEMORY'),
    (VALUE_KEPT_EVERY, 'BEV_VALUE_SPARING_MEMORY')])
def test_a_plan_by_values_needs_each_argument_and_no_more_memory_than_it_asks_for(number, kept_every, room_of):
    arguments, kept = value_call(number, kept_every, room_of=room_of)
    *_, flags, memory, _ = kept
    for missing in range(len(arguments)):
        assert core().bev_plan_by_values(
            *arguments[:missing], 0, *arguments[missing + 1:]) == BAD_ARGUMENT, missing
    assert core().bev_plan_by_values(*arguments) == 0
    assert (flags[-64:] == 3).all() and (memory[-64:] == 7.25).all()


@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_a_plan_by_values_from_what_is_no_number_is_refused(value):
    for name in ('target_c', 'lowest_soc', 'deviation_k'):
        arguments, kept = value_call(4)
        setattr(kept[1], name, value)
        assert core().bev_plan_by_values(*arguments) == BAD_INPUT, name
    for row in range(2):
        arguments, kept = value_call(4)
        kept[2][row, 0] = value
        assert core().bev_plan_by_values(*arguments) < 0, row


@pytest.mark.parametrize('number', [4, 7], ids=['at once', 'late'])
def test_kept_values_are_followed_by_a_shorter_trip_and_by_no_longer_one(number):
    arguments, kept = value_call(number, deviation_k=1.5)
    _, _, states, powers_w, flags, memory, _ = kept
    assert core().bev_plan_by_values(*arguments) == 0
    steps, *first = states.shape[1] - 1, powers_w.tobytes()
    following = [*arguments[:3], steps, *arguments[3:-1]]
    powers_w[:] = np.nan
    assert core().bev_follow_values(*following) == 0
    assert powers_w.tobytes() == first[0]
    for missing in range(len(following)):
        assert core().bev_follow_values(
            *following[:missing], 0, *following[missing + 1:]) == BAD_ARGUMENT, missing
    assert core().bev_follow_values(*following[:3], steps - 1, *following[4:]) == BAD_ARGUMENT
    states[1, 0] += 2.0
    assert core().bev_follow_values(*following) == LEFT
    assert (flags[-64:] == 3).all() and (memory[-64:] == 7.25).all()
