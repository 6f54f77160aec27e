# SPDX-License-Identifier: Apache-2.0
"""
The battery's power limits (9i) and the car's own gates: whether a run keeps them, and the run that does.

Plans that keep the gates heat only where the car would not refuse it. Gates that the route alone decides (not in
motion, steps of power) limit the heater's power in a Trip. Gates that depend on the battery (lowest charge,
highest temperature) close the steps in which a plan would heat against them, and the trip is planned again;
steps only close, so that ends. A plan that still heats against a gate after MOST_REPEATS is cut there, as the
car would.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import math

import numpy as np

from bev_preheat.numerics import BoolArray, FloatArray
from bev_preheat.planning import dynamics, engine
from bev_preheat.planning.heat_run import with_heat
from bev_preheat.planning.schedule import Schedule, switched_on_s
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.trip import Trip
from bev_preheat.tunables import COLDER_BY_K, HEATED_W, MOST_REPEATS, ROUNDING_W
from bev_preheat.vehicle.description import HeatingGates, steps_below_w, Vehicle
from bev_preheat.vehicle.model import make_runge_kutta_4


def colder(vehicle: Vehicle, temperature_c: FloatArray) -> FloatArray:
    """Return temperatures COLDER_BY_K below these [deg C], but not below the vehicle's range."""
    return np.maximum(temperature_c - COLDER_BY_K, vehicle.battery.temperature_range_c[0])


def limits_along(trip: Trip, schedule: Schedule) -> tuple[FloatArray, FloatArray]:
    """Return least and most terminal power [W] (N,) that keep the limits at both ends of a Schedule's steps."""
    return engine.limits_of_steps_w(trip.vehicle, schedule.soc, schedule.temperature_c, trip.power_variance_w2)


def limits_hold(trip: Trip, schedule: Schedule) -> bool:
    """Return whether a schedule made without regard to limits keeps them all."""
    return dynamics.keeps_limits(trip, schedule, engine.limits_of_steps_w)


def drive_as_planned(trip: Trip, state: BatteryState, heater_power_w: FloatArray, take_surplus: bool = False,
                     below_c: float = math.inf) -> Schedule:
    """
    Return the Schedule of a forward run that keeps the limits under heater powers [W] (N,).

    They are wanted in steps that begin colder than `below_c` [deg C], heat under way included, and are cut if the
    battery cannot deliver them or would exceed its highest temperature. With `take_surplus`, regeneration that the
    battery cannot accept goes to the heater first, up to BELOW_HIGHEST_K below that temperature; the friction
    brake takes the rest.

    The state of charge stays within 0 ... 1: the friction brake takes power that would overfill the battery, and
    when the charge runs out the vehicle stands for the rest of the trip.
    """
    states, powers_w, stranded = engine.drive_within_limits(trip, state, heater_power_w, take_surplus, below_c)
    empty_at_s, driven_share = None, None
    if stranded is not None:
        empty, share = stranded
        driven_share = np.where(np.arange(len(trip.route)) < empty, 1.0, 0.0)
        driven_share[empty] = share
        empty_at_s = float(trip.time_s[empty] + share * trip.route.duration_s[empty])
    start_s = switched_on_s(trip, powers_w[0])
    if start_s is not None:
        # A step that is heated in part because of a limit is heated evenly, from its beginning.
        start_s = float(trip.time_s[trip.step_at(start_s)])
    command_w, brake_w, *heat_w = powers_w
    schedule = (with_heat(trip, states, command_w, brake_w, start_s, (heat_w[0], heat_w[1])) if heat_w else
                Schedule(start_s, command_w, brake_w, states[0], states[1], make_runge_kutta_4))
    return replace(schedule, empty_at_s=empty_at_s, driven_share=driven_share)


def run_unheated(trip: Trip, state: BatteryState) -> Schedule:
    """Return the Schedule of a forward run that keeps the limits, heated with free surplus only."""
    return drive_as_planned(trip, state, np.zeros(len(trip.route)), take_surplus=True)


def schedule_within_gates(trip: Trip, state: BatteryState, plan: Callable[[Trip], Schedule],
                          notes: dict[str, None], heater_share: float = 1.0) -> Schedule:
    """Return the Schedule of `plan` that keeps the vehicle's gates; add sentences on them to `notes`."""
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
    power_w = _in_steps(gates, trip, schedule, heater_share)
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
    if gates.power_steps_w and (steps_below_w(gates.power_steps_w, left_w) < left_w - ROUNDING_W).any():
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


def _in_steps(gates: HeatingGates, trip: Trip, schedule: Schedule, heater_share: float) -> FloatArray:
    """Return the power [W] (N,) of a Schedule while the heater is on in each step, in the heater's own steps."""
    power_w = schedule.heater_power_w
    if not gates.power_steps_w or trip.vehicle.heat_sources or heater_share == 0.0:
        return power_w
    start_s, end_s = trip.time_s[:-1], trip.time_s[1:]
    first_s = -np.inf if schedule.heating_start_s is None else schedule.heating_start_s
    last_s = np.inf if schedule.heating_end_s is None else schedule.heating_end_s
    on_share = np.clip((np.minimum(end_s, last_s) - np.maximum(start_s, first_s)) / (end_s - start_s), 1e-9, 1.0)
    # The steps are those of the command. Heat that a step cannot give is owed to the next heated one.
    given = heater_share * on_share
    stepped_w, owed_j = np.zeros(len(power_w)), 0.0
    for k in np.flatnonzero(power_w > HEATED_W):
        length_s = float(end_s[k] - start_s[k])
        command_w = gates.step_below_w((power_w[k] + owed_j / length_s) / given[k] + ROUNDING_W)
        stepped_w[k] = min(command_w * given[k], max(trip.heater_limit_w[k], power_w[k]))
        owed_j += (power_w[k] - stepped_w[k]) * length_s
    # The rest: the heater is on for a part of the last step that it leaves out.
    for k in np.flatnonzero((power_w > HEATED_W) & (stepped_w == 0.0))[-1:]:
        stepped_w[k] = min(owed_j / float(end_s[k] - start_s[k]), trip.heater_limit_w[k])
    return stepped_w


def _sentence_on_steps(gates: HeatingGates) -> str:
    steps = ', '.join(f'{step_w:g}' for step_w in gates.power_steps_w)
    return (f'The heater is either off or at {steps} W.' if len(gates.power_steps_w) == 1 else
            f'The heater has steps of power ({steps} W).')
