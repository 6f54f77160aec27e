# SPDX-License-Identifier: Apache-2.0
"""A car whose charging sessions can be calculated by hand, and an independent integration for any car."""

from dataclasses import replace
import math

import numpy as np

from bev_preheat.numerics import ARRAYS, FLOATS
from bev_preheat.vehicle.curves import PolynomialVoltage, Table
from bev_preheat.vehicle.description import Battery, Charging, Defaults, Drivetrain, Hvch, Leakage, Vehicle

VOLTAGE_V, CAPACITY_AH, HEAT_CAPACITY_J_PER_K = 350.0, 120.0, 300e3
HEATER_W, HEATER_EFFICIENCY = 6000.0, 0.85


def constant(value):
    """Return a curve with one value."""
    return Table((0.0,), (0.0,), ((value,),))


def plain_car(resistance_ohm=1e-9, leakage_w_per_k=0.0, limit=None, heats=False, limit_c=22.0,
              inlet_w=math.inf, ageing=None, **changes):
    """Return a Vehicle of constant voltage; without `limit` its charging power is unlimited."""
    limit = constant(-1e6) if limit is None else limit
    battery = Battery(
        CAPACITY_AH, HEAT_CAPACITY_J_PER_K, PolynomialVoltage((VOLTAGE_V,)),
        constant(resistance_ohm), constant(1e6), constant(-1e6), Leakage(leakage_w_per_k, 1.7),
        (0.0, 1.0), (-40.0, 60.0))
    return replace(
        Vehicle('plain', battery, Drivetrain(0.9, 0.5, 100e3), Hvch(HEATER_W, HEATER_EFFICIENCY),
                Defaults(1000.0, 300.0, 25.0),
                charging=Charging(limit, heats, limit_c, inlet_w, ageing=ageing)), **changes)


def own_session(vehicle, stop, temperature_c, soc, step_s=0.02):
    """
    Return (charging time [s], bought energy [Wh], departure temperature [deg C]), by Euler's method.

    For vehicles without a heat path. The heater is switched at each step, as in the contract.
    """
    battery, charging = vehicle.battery, vehicle.charging
    voltage, resistance, limit = (curve.function(FLOATS) for curve in (
        battery.open_circuit_voltage, battery.resistance, charging.power_limit))
    side_w = stop.cabin_heating_power_w + stop.auxiliary_power_w
    supply_w = min(stop.charger_power_w, charging.maximum_inlet_power_w)
    elapsed_s, bought_j = 0.0, 0.0
    while soc < stop.departure_soc and elapsed_s < 1e5:
        heater_w = 0.0
        if charging.battery_heating and temperature_c < charging.heating_limit_c:
            heater_w = min(vehicle.hvch.maximum_power_w - stop.cabin_heating_power_w,
                           supply_w - side_w)
        power_w = max(0.0, min(supply_w - side_w - heater_w, abs(limit(soc, temperature_c))))
        u, r = voltage(soc, temperature_c), resistance(soc, temperature_c)
        # U I + R I^2 = P
        current_a = (math.sqrt(u * u + 4.0 * r * power_w) - u) / (2.0 * r)
        rate = current_a / (3600.0 * battery.capacity_ah)
        duration_s = min(step_s, (stop.departure_soc - soc) / rate) if rate > 0.0 else step_s
        temperature_c += duration_s / battery.heat_capacity_j_per_k * (
            vehicle.hvch.efficiency * heater_w + r * current_a**2
            + battery.leakage.gamma_0_w_per_k * (stop.ambient_c - temperature_c))
        soc = stop.departure_soc if duration_s < step_s else soc + duration_s * rate
        elapsed_s += duration_s
        bought_j += duration_s * (power_w + side_w + heater_w)
    return elapsed_s, bought_j / 3600.0, temperature_c


def stored_wh(vehicle, soc, temperature_c):
    """Return the integral of U_oc dQ [Wh] along a course, by trapezoids on a fine grid."""
    fine = np.linspace(0.0, len(soc) - 1.0, 20 * (len(soc) - 1) + 1)
    at = np.arange(len(soc))
    socs = np.interp(fine, at, soc)
    volts = vehicle.battery.open_circuit_voltage.function(ARRAYS)(
        socs, np.interp(fine, at, temperature_c))
    return float(0.5 * (volts[1:] + volts[:-1]) @ np.diff(socs)) * vehicle.battery.capacity_ah
