# SPDX-License-Identifier: Apache-2.0
"""
Plans that keep the car's own gates: heat only where the car would not refuse it.

Gates that the route alone decides (not in motion, steps of power) limit the heater's power in a Trip. Gates that
depend on the battery (lowest charge, highest temperature) close the steps in which a plan would heat against them,
and the trip is planned again; steps only close, so that ends. A plan that still heats against a gate after
MOST_REPEATS is cut there, as the car would.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.tunables import HEATED_W, MOST_REPEATS, ROUNDING_W

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.numerics.arrays import BoolArray, FloatArray
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip
    from bev_preheat.vehicle.heating_gates import HeatingGates


def schedule_within_gates(trip: Trip, state: BatteryState, plan: Callable[[Trip], Schedule],
                          notes: dict[str, None]) -> Schedule:
    """
    Return the Schedule of `plan` on a Trip that keeps the gates of its vehicle.

    Sentences on the gates that bind are added to `notes`.
    """
    gates = trip.vehicle.heating_gates
    open_trip, closed = trip, np.zeros(len(trip.route), dtype=bool)
    schedule = plan(trip)
    for _ in range(MOST_REPEATS):
        against = _against_gates(gates, schedule, notes)
        if not against.any():
            break
        closed |= against
        trip = open_trip.changed(heater_limit_w=np.where(closed, 0.0, open_trip.heater_limit_w))
        schedule = plan(trip)
    power_w = _in_steps(gates, trip, schedule)
    if np.abs(power_w - schedule.heater_power_w).max() > ROUNDING_W:
        notes[_sentence_on_steps(gates)] = None
        schedule = drive_as_planned(trip, state, power_w)
    while (against := _against_gates(gates, schedule, notes)).any():
        schedule = drive_as_planned(trip, state, np.where(against, 0.0, schedule.heater_power_w))
    return schedule


def notes_on_route(trip: Trip) -> list[str]:
    """Return sentences on the gates that the route alone decides, if they take heat from a plan that needs it."""
    gates, sentences = trip.vehicle.heating_gates, []
    if gates.only_while_standing and (trip.heater_limit_w <= 0.0).any():
        sentences.append('The vehicle heats its battery only while it stands.')
    left_w = np.maximum(trip.vehicle.hvch.maximum_power_w - trip.route.cabin_heating_power_w, 0.0)
    if gates.power_steps_w and (gates.steps_below_w(left_w) < left_w - ROUNDING_W).any():
        sentences.append(_sentence_on_steps(gates))
    return sentences


def _against_gates(gates: HeatingGates, schedule: Schedule, notes: dict[str, None]) -> BoolArray:
    """Return the steps (N,) that a Schedule heats although the battery's state closes a gate in them."""
    heated = schedule.heater_power_w > HEATED_W
    low = heated & (np.minimum(schedule.soc[:-1], schedule.soc[1:]) < gates.minimum_soc)
    hot = heated & (np.maximum(schedule.temperature_c[:-1], schedule.temperature_c[1:])
                    >= gates.maximum_temperature_c)
    if low.any():
        notes[f'The vehicle does not heat below {100.0 * gates.minimum_soc:g} % of charge.'] = None
    if hot.any():
        notes[f'The vehicle does not heat from {gates.maximum_temperature_c:g} degC on.'] = None
    return low | hot


def _in_steps(gates: HeatingGates, trip: Trip, schedule: Schedule) -> FloatArray:
    """Return the power [W] (N,) of a Schedule while the heater is on in each step, in the heater's own steps."""
    power_w = schedule.heater_power_w
    if not gates.power_steps_w:
        return power_w
    start_s, end_s = trip.time_s[:-1], trip.time_s[1:]
    first_s = -np.inf if schedule.heating_start_s is None else schedule.heating_start_s
    last_s = np.inf if schedule.heating_end_s is None else schedule.heating_end_s
    on_share = np.clip((np.minimum(end_s, last_s) - np.maximum(start_s, first_s)) / (end_s - start_s), 1e-9, 1.0)
    stepped_w: FloatArray = gates.steps_below_w(power_w / on_share + ROUNDING_W) * on_share
    return np.minimum(stepped_w, power_w)


def _sentence_on_steps(gates: HeatingGates) -> str:
    steps = ', '.join(f'{step_w:g}' for step_w in gates.power_steps_w)
    return (f'The heater is either off or at {steps} W.' if len(gates.power_steps_w) == 1 else
            f'The heater has steps of power ({steps} W).')
