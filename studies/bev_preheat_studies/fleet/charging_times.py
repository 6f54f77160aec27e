# SPDX-License-Identifier: Apache-2.0
"""
Minutes and energy at the charger as a function of the state on arrival, one table for each car and charger.

A fleet has millions of charging sessions. Their equations are those of `charging.session`, for vehicles
without a heat path. The sessions of a grid are simulated together, in arrays, and interpolated in between.
A test bounds the difference from `session.charge`.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.charging.equations import (
    charging_power,
    heater_power_of,
    make_charging_rates,
    make_charging_step,
    make_cooling,
    supply_of,
)
from bev_preheat.charging.stop import ChargingStop
from bev_preheat.numerics.arithmetic import ARRAYS
from bev_preheat.planning.dynamics import hottest_c
from bev_preheat.vehicle.charging import charging_of, vehicle_at_charger
from bev_preheat.vehicle.model import make_rates
from bev_preheat_studies.fleet.drawn_fleet import (
    ARRIVAL_SOC,
    cabin_heating_power_w,
    DEPARTURE_SOC,
    vehicle_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle.description import Vehicle

    IntArray = NDArray[np.int64]

# The grid: air and battery temperature [deg C], state of charge on arrival. Sessions are longest in the cold,
# so the grid is finest there.
AMBIENT_GRID_C = np.array([-25.0, -22.0, -19.0, -16.0, -13.0, -10.0, -5.0, 0.0, 7.0, 15.0])
TEMPERATURE_GRID_C = np.array([*np.arange(-26.0, 28.0, 2.0), 32.0, 38.0, 46.0, 56.0, 80.0])
SOC_GRID = np.linspace(0.0, ARRIVAL_SOC[1] + 0.05, 8)
# Longest step [s], and largest change of the state of charge in a step.
STEP_S, STEP_SOC = 30.0, 0.01
# A session longer than this [s] counts as never charged.
LONGEST_S = 6 * 3600.0
J_PER_WH = 3600.0
KEPT_TABLES = 64


class ChargingTimes:
    """Time [s] and energy bought [Wh] of sessions of one car at one charger."""

    def __init__(self, vehicle: Vehicle, charger_w: float) -> None:
        """Simulate the sessions of the grid."""
        from scipy.interpolate import RegularGridInterpolator
        grid = (AMBIENT_GRID_C, TEMPERATURE_GRID_C, SOC_GRID)
        points = np.meshgrid(*grid, indexing='ij')
        found = sessions(vehicle, charger_w, *(axis.ravel() for axis in points))
        self._table = RegularGridInterpolator(
            grid, np.stack(found, axis=-1).reshape(*points[0].shape, 2), bounds_error=False,
            fill_value=np.nan)

    def of(self, ambient_c: FloatArray, temperature_c: FloatArray,
           soc: FloatArray) -> tuple[FloatArray, FloatArray]:
        """
        Return time [s] and energy bought [Wh], shapes (N,), for states on arrival, shapes (N,).

        NaN or infinite if the session does not end or the state is outside the grid.
        """
        found = self._table(np.stack((ambient_c, temperature_c, soc), axis=-1))
        return found[:, 0], found[:, 1]


@lru_cache(maxsize=KEPT_TABLES)
def charging_times_of(car: str, charger_w: float) -> ChargingTimes:
    """Return the ChargingTimes of a car of the fleet at a charger [W]; cached in each process."""
    return ChargingTimes(vehicle_of(car), charger_w)


def stop_of(vehicle: Vehicle, charger_w: float, ambient_c: float) -> ChargingStop:
    """Return the ChargingStop of a fleet trip at this air temperature [deg C]."""
    return ChargingStop(charger_w, DEPARTURE_SOC, ambient_c, float(cabin_heating_power_w(vehicle, ambient_c)),
                        vehicle.defaults.auxiliary_power_w)


def sessions(vehicle: Vehicle, charger_w: float, ambient_c: FloatArray, temperature_c: FloatArray,
             soc: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return time [s] and energy bought [Wh] of sessions; all shapes (N,).

    Infinite if a session does not end.
    """
    if not vehicle.heat_path.is_direct:
        raise ValueError(f'{vehicle.name}: has a heat path, which is not simulated here')
    session = _Sessions(vehicle, charger_w, ambient_c)
    soc, temperature_c = soc.copy(), temperature_c.copy()
    elapsed_s, bought_j = np.zeros(len(soc)), np.zeros(len(soc))
    at = np.flatnonzero(soc < DEPARTURE_SOC)
    while len(at):
        soc[at], temperature_c[at], duration_s, bought_w = session.step(at, soc[at], temperature_c[at])
        elapsed_s[at] += duration_s
        bought_j[at] += duration_s * bought_w
        elapsed_s[at[elapsed_s[at] > LONGEST_S]] = np.inf
        at = at[(soc[at] < DEPARTURE_SOC) & np.isfinite(elapsed_s[at])]
    return elapsed_s, np.where(np.isinf(elapsed_s), np.inf, bought_j / J_PER_WH)


class _Sessions:
    """Sessions of one car at one charger, in air of different temperatures [deg C]."""

    def __init__(self, vehicle: Vehicle, charger_w: float, ambient_c: FloatArray) -> None:
        charging = charging_of(vehicle)
        if charging.cooling is not None:
            raise ValueError(f'{vehicle.name}: cools its battery, which is not simulated here')
        self._vehicle, self._limited_c = vehicle, charging.heated_below_c
        self._hottest_c = hottest_c(vehicle)
        self._limit_w = charging.power_limit.function(ARRAYS)
        self._voltage_v = vehicle.battery.open_circuit_voltage.function(ARRAYS)
        self._leakage_w_per_k = vehicle.battery.leakage.coefficient_w_per_k(0.0)
        self._integrate = make_charging_step(make_charging_rates(
            self._limit_w, make_cooling(None, 0.0, ARRAYS), make_rates(vehicle_at_charger(vehicle), ARRAYS),
            ARRAYS))
        stops = {value: stop_of(vehicle, charger_w, value) for value in np.unique(ambient_c).tolist()}

        def of_stop(value_of: Callable[[ChargingStop], float]) -> FloatArray:
            values = {ambient: value_of(stop) for ambient, stop in stops.items()}
            return np.array([values[ambient] for ambient in ambient_c.tolist()])

        self._idle_heat_w = self._leakage_w_per_k * ambient_c
        self._supply_w = of_stop(lambda stop: supply_of(vehicle, stop))
        self._heater_w = of_stop(lambda stop: heater_power_of(vehicle, stop))
        self._side_w = of_stop(lambda stop: stop.cabin_heating_power_w + stop.auxiliary_power_w)

    def step(self, at: IntArray, soc: FloatArray,
             temperature_c: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return soc and temperature [deg C] after a step, its duration [s], and the purchased power [W]."""
        supply_w, heater_w = self._supply_w[at], self._heater_w[at]
        power_w = charging_power(self._limit_w(soc, temperature_c), supply_w, ARRAYS)
        full_s = (self._vehicle.battery.capacity_as * self._voltage_v(soc, temperature_c)
                  / np.maximum(power_w, 1.0))
        duration_s = np.minimum(STEP_S, STEP_SOC * full_s)

        def driven(command_w: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            end_soc, end_c, _, powers = self._integrate(
                soc, temperature_c, duration_s, command_w - supply_w, np.zeros(len(at)),
                self._idle_heat_w[at] + self._vehicle.hvch.efficiency * command_w,
                np.full(len(at), self._leakage_w_per_k))
            return end_soc, np.minimum(end_c, self._hottest_c), powers.terminal_w

        command_w = np.where(temperature_c < self._limited_c, heater_w, 0.0)
        end_soc, end_c, terminal_w = driven(command_w)
        # The heater's mean power at the limit, which switching on below and off above the limit also gives.
        crosses = np.where(temperature_c < self._limited_c, end_c > self._limited_c,
                           end_c < self._limited_c) & (heater_w > 0.0)
        if crosses.any():
            cold_c, hot_c = driven(np.zeros(len(at)))[1], driven(heater_w)[1]
            share = np.clip((self._limited_c - cold_c) / np.maximum(hot_c - cold_c, 1e-12), 0.0, 1.0)
            command_w = np.where(crosses, share * heater_w, command_w)
            end_soc, end_c, terminal_w = driven(command_w)
        # Shorten the last step to end exactly at the departure's state of charge.
        lasts = np.minimum(1.0, (DEPARTURE_SOC - soc) / np.maximum(end_soc - soc, 1e-12))
        return end_soc, end_c, lasts * duration_s, terminal_w + command_w + self._side_w[at]
