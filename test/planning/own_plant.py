# SPDX-License-Identifier: Apache-2.0
"""
A plant for tests of plans that shares no code with the model: vehicle YAML, Euler steps.

It draws the drive's power even if the battery's limit is lower, and reports the deficit.
"""

from bisect import bisect_right
from dataclasses import dataclass
from math import ceil, sqrt
from pathlib import Path

import numpy as np
import yaml

from bev_preheat.vehicle.description import DIRECT

STEP_S = 2.0


@dataclass(frozen=True)
class Driven:
    """
    Result of a drive; `empty_at_s` [s] is None if the charge was enough.

    `beyond_w` (N, 2) is the largest excess of P_b over discharge and charge limit in each step [W]. A heater with
    lag draws its last power after arrival: the energies contain that, too.
    """

    soc: float
    temperature_c: float
    lowest_soc: float
    deficit_w: float
    empty_at_s: float | None
    beyond_w: np.ndarray
    coolant_excess_k: float
    heater_wh: float
    cells_wh: float


def between(axis, x):
    """Return (index, share): x lies that share of the way from a point to the next; constant beyond."""
    index = min(max(bisect_right(axis, x), 1), len(axis) - 1) - 1
    return index, min(max((x - axis[index]) / (axis[index + 1] - axis[index]), 0.0), 1.0)


def table(node):
    """Return f(soc, temperature_c) of a table node: along the temperature first, then the charge."""
    values = np.atleast_2d(np.array(node['values'], dtype=float))
    if 'temperature_c' not in node:
        values = values.reshape(-1, 1)
    axes = []
    for axis, name in enumerate(('soc', 'temperature_c')):
        axes.append(node.get(name, [0.0, 1.0]))
        if name not in node:
            values = np.repeat(values, 2, axis=axis)
    socs, temperatures_c = axes
    rows = values.tolist()

    def value(soc, temperature_c):
        # Looked up in every step of every drive: floats, because arrays of two would take ten times longer.
        (row, share), (column, warm) = between(socs, soc), between(temperatures_c, temperature_c)
        low, high = ((1.0 - warm) * one[column] + warm * one[column + 1]
                     for one in rows[row:row + 2])
        return (1.0 - share) * low + share * high

    return value


class HeatOnItsWay:
    """A heater whose power follows its command with a lag, and the coolant that takes its heat to the battery."""

    def __init__(self, path, state, efficiency):
        self.path, self.efficiency = path, efficiency
        self.power_w, self.coolant_c = state.heater_power_w, state.temperature_c + state.coolant_excess_k

    def excess_k(self, battery_c):
        return self.coolant_c - battery_c if self.path.has_coolant else 0.0

    def drawn_w(self, command_w, step_s):
        """Return the mean power drawn in a step [W]."""
        lag_s = self.path.heater_lag_s
        return self.power_w + 0.5 * step_s * (command_w - self.power_w) / lag_s if lag_s else command_w

    def arriving_w(self, drawn_w, command_w, step_s, battery_c):
        """Go on by a step; return the heat into the battery [W]."""
        heat_w = self.efficiency * drawn_w
        if self.path.heater_lag_s:
            self.power_w += step_s * (command_w - self.power_w) / self.path.heater_lag_s
        if not self.path.has_coolant:
            return heat_w
        passed_w = self.path.coolant_conductance_w_per_k * self.excess_k(battery_c)
        self.coolant_c += step_s * (heat_w - passed_w) / self.path.coolant_heat_capacity_j_per_k
        return passed_w


class OwnPlant:
    """The car of a vehicle file."""

    def __init__(self, name):
        """Read config/vehicles/NAME.yaml."""
        folder = Path(__file__).parents[2] / 'config' / 'vehicles'
        contents = yaml.safe_load((folder / f'{name}.yaml').read_text(encoding='utf-8'))
        battery, drivetrain = contents['battery'], contents['drivetrain']
        self._heat_capacity = battery['heat_capacity_j_per_k']
        self._charge_as = 3600.0 * battery['capacity_ah']
        self._leakage = battery['leakage']
        self._heat_share = (
            drivetrain['heat_recovery_efficiency'] * (1.0 - drivetrain['efficiency']))
        self._heater_efficiency = contents['hvch']['efficiency']
        self.lowest_soc = battery['soc_range'][0]
        voltage, resistance = battery['open_circuit_voltage'], battery['resistance']
        if 'formula' in voltage:
            polynomial = np.polynomial.Polynomial(voltage['formula']['polynomial_v'])
            self.voltage_v = lambda soc, temperature_c: float(polynomial(soc))
        else:
            self.voltage_v = table(voltage['table'])
        if 'formula' in resistance:
            law = resistance['formula']
            self.resistance_ohm = lambda soc, temperature_c: (
                law['k_ohm_k'] / (temperature_c + law['reference_temperature_c']))
        else:
            self.resistance_ohm = table(resistance['table'])
        self.discharge_w = table(battery['power_limits']['discharge'])
        self.charge_w = table(battery['power_limits']['charge'])

    def drive(self, route, state, heater_w, brake_w=None, path=DIRECT, longest_s=STEP_S):
        """Return the Driven of a Route from a BatteryState, with heater [W] (N,) and brake as given or needed."""
        soc, temperature_c, lowest_soc = state.soc, state.temperature_c, state.soc
        deficit_w, now_s, beyond_w, drawn_j, cells_j = 0.0, 0.0, [], 0.0, 0.0
        heater = HeatOnItsWay(path, state, self._heater_efficiency)
        columns = (route.duration_s, route.speed_mps, route.propulsion_power_w,
                   route.propulsion_power_rms_w, route.propulsion_power_magnitude_w, route.ambient_temperature_c,
                   route.cabin_heating_power_w + route.auxiliary_power_w, heater_w,
                   np.full(len(route), np.nan) if brake_w is None else brake_w)
        for duration_s, speed, drive_w, rms_w, magnitude_w, ambient_c, others_w, command_w, given_w in zip(
                *(column.tolist() for column in columns)):
            leakage = (self._leakage['gamma_0_w_per_k']
                       + self._leakage['gamma_v_w_per_k_per_mps'] * speed)
            worst_w = (-np.inf, -np.inf)
            step_s = duration_s / (steps := ceil(duration_s / longest_s))
            for part in range(steps + 1):
                u = self.voltage_v(soc, temperature_c)
                r = self.resistance_ohm(soc, temperature_c)
                ripple_w = r * max(rms_w**2 - drive_w**2, 0.0) / u**2
                limits_w = self.discharge_w(soc, temperature_c), self.charge_w(soc, temperature_c)
                most_a, least_a = ((limit_w - ripple_w) / u for limit_w in limits_w)
                taken_w = heater.drawn_w(command_w, step_s)
                asked_w = drive_w + others_w + taken_w
                braked_w = given_w if given_w == given_w else min(
                    max(0.0, u * least_a - r * least_a**2 - asked_w), max(-drive_w, 0.0))
                # From the start of a step to its end, where the charge is lowest.
                deficit_w = max(deficit_w, asked_w - (u * most_a - r * most_a**2))
                current_a = (u - sqrt(max(u**2 - 4.0 * r * (asked_w + braked_w), 0.0))) / (2.0 * r)
                power_w = u * current_a + ripple_w
                worst_w = max(worst_w[0], power_w - limits_w[0]), max(worst_w[1], limits_w[1] - power_w)
                if part == steps:
                    break
                soc -= (current_a + ripple_w / u) / self._charge_as * step_s
                arriving_w = heater.arriving_w(taken_w, command_w, step_s, temperature_c)
                temperature_c += step_s / self._heat_capacity * (
                    arriving_w + leakage * (ambient_c - temperature_c)
                    + r * current_a**2 + ripple_w + self._heat_share * (magnitude_w - braked_w))
                now_s, drawn_j, cells_j = now_s + step_s, drawn_j + step_s * taken_w, cells_j + step_s * power_w
                lowest_soc = min(lowest_soc, soc)
                if soc <= 0.0:
                    return Driven(0.0, temperature_c, 0.0, deficit_w, now_s, np.array([*beyond_w, worst_w]),
                                  heater.excess_k(temperature_c), drawn_j / 3600.0, cells_j / 3600.0)
            beyond_w.append(worst_w)
        left_j = path.heater_lag_s * heater.power_w
        return Driven(soc, temperature_c, lowest_soc, deficit_w, None, np.array(beyond_w),
                      heater.excess_k(temperature_c), (drawn_j + left_j) / 3600.0, (cells_j + left_j) / 3600.0)
