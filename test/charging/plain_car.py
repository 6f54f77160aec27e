# SPDX-License-Identifier: Apache-2.0
"""A car whose charging sessions can be calculated by hand, an integration for any car, and the drive before."""

from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np
from own_ageing import own_cost_per_s
import pytest

from bev_preheat.charging.session import charge
from bev_preheat.numerics import ARRAYS, FLOATS
from bev_preheat.route import Route
from bev_preheat.vehicle.curves import PolynomialVoltage, Table
from bev_preheat.vehicle.description import Battery, Charging, Defaults, Drivetrain, Hvch, Leakage, Vehicle

VOLTAGE_V, CAPACITY_AH, HEAT_CAPACITY_J_PER_K = 350.0, 120.0, 300e3
HEATER_W, HEATER_EFFICIENCY = 6000.0, 0.85


def drive(minutes=25, ambient_c=-8.0, cabin_w=1500.0, power_w=15e3):
    """Return a Route of one-minute steps at 90 km/h."""
    return Route(np.full(minutes, 60.0), *(np.full(minutes, value) for value in (
        25.0, power_w, power_w, ambient_c, cabin_w, 400.0, power_w)))


def constant(value):
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


class OwnSession(NamedTuple):
    """Charging time [s], bought energy [Wh], temperature at departure [deg C], price of the ageing."""

    time_s: float
    bought_wh: float
    end_c: float
    aged: float

    def cost(self, prices):
        return prices.energy_per_kwh * self.bought_wh / 1e3 + prices.time_per_h * self.time_s / 3600.0 + self.aged


def own_session(vehicle, stop, state, step_s=0.5, is_on=lambda elapsed_s, soc, temperature_c: True):
    """
    Return the OwnSession from a BatteryState, by the midpoint rule; infinite after a day.

    The car heats below its limit where `is_on`; the heater is switched at each step by the energy that has not
    arrived.
    """
    battery, charging, path, heater = vehicle.battery, vehicle.charging, vehicle.heat_path, vehicle.hvch
    voltage, resistance, limit = (curve.function(FLOATS) for curve in (
        battery.open_circuit_voltage, battery.resistance, charging.power_limit))
    side_w = stop.cabin_heating_power_w + stop.auxiliary_power_w
    supply_w = min(stop.charger_power_w, charging.maximum_inlet_power_w) - side_w
    battery_j_per_k, coolant_j_per_k = battery.heat_capacity_j_per_k, path.coolant_heat_capacity_j_per_k

    def cooled_w(temperature_c):
        cooling = charging.cooling
        if cooling is None or temperature_c <= cooling.set_point_c:
            return 0.0, 0.0
        share = min(1.0, (temperature_c - cooling.set_point_c) / cooling.proportional_band_k)
        heat_w = min(share * cooling.cooling_power_w, max(
            0.0, cooling.radiator_conductance_w_per_k * (temperature_c - stop.ambient_c)))
        return heat_w, heat_w * cooling.electrical_power_w / cooling.cooling_power_w

    def rates(soc, temperature_c, coolant_c, heater_w, command_w):
        """Return the changes of the four states in a second, and the power from the charger [W]."""
        drawn_w = heater_w if path.heater_lag_s else command_w
        lost_w, fan_w = cooled_w(temperature_c)
        power_w = max(0.0, min(supply_w - drawn_w - fan_w, -limit(soc, temperature_c)))
        u, r = voltage(soc, temperature_c), charging.polarization_factor * resistance(soc, temperature_c)
        # U I + R I^2 = P
        current_a = (math.sqrt(u * u + 4.0 * r * power_w) - u) / (2.0 * r)
        made_w = heater.efficiency * drawn_w
        passed_w = path.coolant_conductance_w_per_k * (coolant_c - temperature_c) if coolant_j_per_k else made_w
        heat_w = passed_w - lost_w + r * current_a**2 + battery.leakage.gamma_0_w_per_k * (
            stop.ambient_c - temperature_c)
        return (current_a / battery.capacity_as, heat_w / battery_j_per_k,
                (made_w - passed_w) / coolant_j_per_k if coolant_j_per_k else 0.0,
                (command_w - heater_w) / path.heater_lag_s if path.heater_lag_s else 0.0,
                power_w + side_w + drawn_w + fan_w)

    y = np.array([state.soc, state.temperature_c, state.temperature_c + state.coolant_excess_k,
                  state.heater_power_w])
    elapsed_s, bought_j, aged = 0.0, 0.0, 0.0
    while y[0] < stop.departure_soc:
        if elapsed_s > 86400.0:
            return OwnSession(*4 * (math.inf,))
        soc, temperature_c, coolant_c, heater_w = y.tolist()
        all_c = (battery_j_per_k * temperature_c + coolant_j_per_k * coolant_c
                 + heater.efficiency * path.heater_lag_s * heater_w) / (battery_j_per_k + coolant_j_per_k)
        is_heating = charging.battery_heating and all_c < charging.heating_limit_c and is_on(elapsed_s, soc, all_c)
        command_w = is_heating * min(heater.maximum_power_w - stop.cabin_heating_power_w, supply_w)
        first = np.array(rates(*y.tolist(), command_w)[:4])
        *middle, drawn_w = rates(*(y + 0.5 * step_s * first).tolist(), command_w)
        h = min(step_s, (stop.departure_soc - soc) / middle[0]) if middle[0] > 0.0 else step_s
        y += h * np.array(middle)
        elapsed_s, bought_j = elapsed_s + h, bought_j + h * drawn_w
        if charging.ageing is not None:
            aged += h * own_cost_per_s(*y[:2].tolist(), middle[0], charging.ageing)
        if h < step_s:
            break
    return OwnSession(elapsed_s, bought_j / 3600.0, float(y[1]), aged)


def same_session(vehicle, stop, state, tolerance):
    """Return the Session from a BatteryState, which must be the OwnSession to a relative tolerance and 0.01 K."""
    session, own = charge(vehicle, stop, state), own_session(vehicle, stop, state)
    assert (session.charging_time_s, session.bought_energy_wh) == pytest.approx(
        (own.time_s, own.bought_wh), rel=tolerance)
    assert session.battery_temperature_c[-1] == pytest.approx(own.end_c, abs=0.01)
    return session


def stored_wh(vehicle, soc, temperature_c):
    """Return the integral of U_oc dQ [Wh] along a course, by trapezoids on a fine grid."""
    fine = np.linspace(0.0, len(soc) - 1.0, 20 * (len(soc) - 1) + 1)
    at = np.arange(len(soc))
    socs = np.interp(fine, at, soc)
    volts = vehicle.battery.open_circuit_voltage.function(ARRAYS)(
        socs, np.interp(fine, at, temperature_c))
    return float(0.5 * (volts[1:] + volts[:-1]) @ np.diff(socs)) * vehicle.battery.capacity_ah
