# SPDX-License-Identifier: Apache-2.0
"""A run that `value_function` tries: its steps, its cost, and an edge of its heating moved to arrive exactly."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.numerics import ARRAYS, JOULES_PER_WH
from bev_preheat.planning.dynamics import limits_of_steps_w
from bev_preheat.planning.heat_run import heated_heat_capacity_j_per_k
from bev_preheat.planning.limited_drive import make_limited_drive
from bev_preheat.planning.steps_ahead import direction_of
from bev_preheat.tunables import (
    ARRIVAL_TOLERANCE_K,
    HEATING_PRICE,
    LACK_TOLERANCE_W,
    LEAST_HEATING_W,
    MOST_TRIALS,
    MOVED_K,
    SHORT_PRICE,
    SWITCH_ON_EXPECTED_WH,
    SWITCH_ON_WH,
)

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray
    from bev_preheat.planning.heat_run import States
    from bev_preheat.planning.methods import Requirements
    from bev_preheat.planning.trip import Trip


class ValueRun:
    """
    States (4, N + 1) and powers (4, N) of a run: those of `limited_drive.make_limited_drive`.

    `joules_per_k` is the heater's energy for a kelvin; `ends_in` the step within which heating ends, or None.
    """

    def __init__(self, trip: Trip, start: States, wanted: Requirements, lack_price: float) -> None:
        """Take the States at the start; `lack_price` is the cost of a joule that the battery cannot deliver."""
        vehicle, steps = trip.vehicle, len(trip.route)
        self._trip, self._wanted, self._lack_price = trip, wanted, lack_price
        self.price = np.ones(steps) if wanted.price is None else wanted.price
        self.is_certain = not wanted.uncertainty.deviation_k > 0.0
        self.switch_on_j = JOULES_PER_WH * (SWITCH_ON_WH if self.is_certain else SWITCH_ON_EXPECTED_WH)
        self.joules_per_k = heated_heat_capacity_j_per_k(vehicle) / vehicle.hvch.efficiency
        self._highest_c = vehicle.battery.temperature_range_c[1]
        self.voltage_v = vehicle.battery.open_circuit_voltage.function(ARRAYS)
        self._drives = [make_limited_drive(trip, takes_surplus) for takes_surplus in (False, True)]
        self.states, self.powers_w = np.zeros((4, steps + 1)), np.zeros((4, steps))
        self.states[:, 0] = start
        # The step to which an edge was moved at last.
        self._moved_in = 0
        self.ends_in: int | None = None

    @property
    def arrival_c(self) -> float:
        """Temperature on arrival [deg C]."""
        return float(self.states[1, -1])

    def drive(self, k: int, wanted_w: float, takes_surplus: bool) -> bool:
        """Drive step k; return whether the charge carries it."""
        states, powers_w = self._drives[takes_surplus](k, tuple(self.states[:, k].tolist()), wanted_w)
        self.powers_w[:, k] = powers_w
        self.states[:, k + 1] = states
        return states[0] > 0.0

    def drive_commands(self, command_w: FloatArray | None) -> bool:
        """Drive commands [W] (N,); None: only surplus heats."""
        return all(self.drive(k, 0.0 if command_w is None else float(command_w[k]), command_w is None)
                   for k in range(len(self._trip.route)))

    def keep(self) -> tuple[FloatArray, FloatArray]:
        """Return copies of states and powers."""
        return self.states.copy(), self.powers_w.copy()

    def take(self, kept: tuple[FloatArray, FloatArray]) -> None:
        """Take copies of kept states and powers."""
        self.states, self.powers_w = (values.copy() for values in kept)

    def beyond_k(self, is_short_of_charge: bool, cools: bool = False, states: FloatArray | None = None) -> float:
        """
        Return how much too warm the battery arrives [K]: for the target, or for the reserve of charge.

        `cools`: how much too cold, for the highest temperature. `states` are those of another run.
        """
        soc, arrival_c = (self.states if states is None else states)[:2, -1]
        if not is_short_of_charge:
            return float(self._wanted.most_c - arrival_c if cools else arrival_c - self._wanted.target_c)
        voltage_v = self.voltage_v(np.array([soc]), np.array([arrival_c]))[0]
        energy_j = (self._wanted.reserve - soc) * self._trip.vehicle.battery.capacity_as * voltage_v
        return float(energy_j / self.joules_per_k)

    def lack_w(self) -> float:
        """Return the largest power deficit [W]."""
        return float(self._lacking_along_w(self.states, self.powers_w).max())

    def _lacking_along_w(self, states: FloatArray, powers_w: FloatArray) -> FloatArray:
        """Return the power of each step beyond the discharge limit [W]."""
        trip = self._trip
        _, most_w = limits_of_steps_w(trip.vehicle, states[0], states[1], trip.power_variance_w2)
        lacking_w: FloatArray = trip.idle_power_w + powers_w[2] + powers_w[1] - most_w
        return np.where(lacking_w > LACK_TOLERANCE_W, lacking_w, 0.0)

    def cost_j(self, aim_c: float, kept: tuple[FloatArray, FloatArray] | None = None) -> float:
        """Return the cost [J]: battery, heater, power deficit, switching, missed aim [deg C] and reserve."""
        states, powers_w = kept or (self.states, self.powers_w)
        trip, (soc, temperature_c) = self._trip, states[:2]
        voltage_v = self.voltage_v(soc, temperature_c)
        charge_as = trip.vehicle.battery.capacity_as * (soc[:-1] - soc[1:])
        energy_j = self.price @ (0.5 * (voltage_v[1:] + voltage_v[:-1]) * charge_as)
        lacking_w = self._lacking_along_w(states, powers_w)
        direction = np.append(self._wanted.uncertainty.direction, direction_of(powers_w[0]))
        switched_j = self.switch_on_j * float(((direction[1:] != 0) & (direction[1:] != direction[:-1])).sum())
        arrival_c = float(temperature_c[-1])
        short_k = max(aim_c - arrival_c, arrival_c - self._wanted.most_c, 0.0) + max(
            self.beyond_k(True, states=states), 0.0)
        if trip.mix.cools:
            short_k += float(np.maximum(temperature_c[1:] - self._highest_c, 0.0).sum())
        heater_j = float((self.price * trip.route.duration_s) @ powers_w[0 if trip.mix.is_alone else 2])
        lacking_j = float(trip.route.duration_s @ lacking_w)
        return (float(energy_j) + HEATING_PRICE * heater_j + self._lack_price * lacking_j + switched_j
                + SHORT_PRICE * self.joules_per_k * short_k)

    def arrive_exactly(self, aim_c: float) -> FloatArray:
        """Return the commands [W] (N,), an edge of heating moved to arrive exactly unless that costs more."""
        kept = self.keep()
        self._move_edge()
        if self.cost_j(aim_c) > self.cost_j(aim_c, kept):
            # The heat beyond the target was for limits on the way.
            self.take(kept)
            self.ends_in = None
        command_w: FloatArray = self.powers_w[0]
        return command_w

    def _move_edge(self) -> None:
        command_w = self.powers_w[0].copy()
        switched_w = command_w[np.abs(command_w) > LEAST_HEATING_W]
        # Of the cooling, if that comes last, in the same way.
        cools = bool(len(switched_w) and switched_w[-1] < 0.0)
        sign, limit_w = (-1.0, -self._trip.most_cold_w) if cools else (1.0, self._trip.heater_limit_w)
        command_w = sign * command_w
        heated, braked = command_w > LEAST_HEATING_W, self.powers_w[1] > 1.0
        beside = np.append(False, heated[:-1]) if self.is_certain else np.append(heated[1:], False)
        edges = np.flatnonzero(heated & ~braked & ~beside)
        to_target_k, to_reserve_k = (self.beyond_k(of_charge, cools) for of_charge in (False, True))
        is_short = to_target_k < 0.0 and to_reserve_k > to_target_k
        excess_k = to_reserve_k if is_short else to_target_k
        if not len(edges):
            return
        step_k = float(limit_w[edges[-1]] * self._trip.route.duration_s[edges[-1]]) / self.joules_per_k
        if not abs(excess_k) <= (MOVED_K if self.is_certain else max(MOVED_K, step_k)):
            return
        moved_j, next_j = 0.0, -excess_k * self.joules_per_k
        for _ in range(MOST_TRIALS):
            if abs(excess_k) <= ARRIVAL_TOLERANCE_K:
                break
            self.drive_commands(sign * self._with_edge_moved(command_w, int(edges[-1]), next_j, limit_w))
            found_k = self.beyond_k(is_short, cools)
            slope = (found_k - excess_k) / (next_j - moved_j)
            moved_j, excess_k = next_j, found_k
            if not math.isfinite(slope) or slope == 0.0:
                break
            next_j = moved_j - excess_k / slope
        is_last = not self.powers_w[0, self._moved_in + 1:].any()
        if moved_j != 0.0 and is_last and not cools and not self.is_certain:
            self.ends_in = self._moved_in

    def _with_edge_moved(self, command_w: FloatArray, edge: int, more_j: float, limit_w: FloatArray) -> FloatArray:
        """Return commands with more energy outside an interval that begins or ends at `edge`, or less [J]."""
        moved_w, left_j = command_w.copy(), abs(more_j)
        is_later = (more_j > 0.0) != self.is_certain
        for k in range(edge, len(command_w)) if is_later else range(edge, -1, -1):
            duration_s = float(self._trip.route.duration_s[k])
            most_w = float(limit_w[k])
            room_w = most_w - moved_w[k] if more_j > 0.0 else moved_w[k]
            taken_j = min(max(room_w, 0.0) * duration_s, left_j)
            self._moved_in = k if taken_j > 0.0 else self._moved_in
            moved_w[k] = max(min(moved_w[k] + math.copysign(taken_j / duration_s, more_j), most_w), 0.0)
            left_j -= taken_j
            if left_j <= 0.0:
                break
        return moved_w
