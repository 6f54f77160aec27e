# SPDX-License-Identifier: Apache-2.0
"""The car's equations written a second time: eqs. (1)-(5) for plain floats, driven by Runge-Kutta steps."""

from dataclasses import asdict

import numpy as np


def segments_of(route):
    columns = {name: values.tolist() for name, values in asdict(route).items()}
    return [dict(zip(columns, row)) for row in zip(*columns.values())]


def bilinear(table, soc, temperature_c):
    """Along temperature in each row, then along soc; constant beyond the ends."""
    rows = [np.interp(temperature_c, table.temperature_c, row) for row in table.values]
    return np.interp(soc, table.soc, rows)


class Car:
    """The model of one Vehicle."""

    def __init__(self, vehicle):
        self.vehicle, self.battery = vehicle, vehicle.battery

    def voltage_v(self, soc, temperature_c):
        curve = self.battery.open_circuit_voltage
        if hasattr(curve, 'values'):
            return bilinear(curve, soc, temperature_c)
        c0, c1, c2, c3 = curve.polynomial_v
        return c0 + c1 * soc + c2 * soc**2 + c3 * soc**3

    def resistance_ohm(self, soc, temperature_c):
        curve = self.battery.resistance
        if hasattr(curve, 'values'):
            return bilinear(curve, soc, temperature_c)
        return curve.k_ohm_k / (temperature_c + curve.reference_temperature_c)

    def heat_and_power(self, soc, temperature_c, segment, heater_w, brake_w=0.0):
        """Joule heat, all heat into the battery, power P_b of the cells, mean current [W, A]."""
        terminal_w = (segment['propulsion_power_w'] + segment['cabin_heating_power_w']
                      + segment['auxiliary_power_w'] + heater_w + brake_w)
        u, r = self.voltage_v(soc, temperature_c), self.resistance_ohm(soc, temperature_c)
        variance_w2 = segment['propulsion_power_rms_w']**2 - segment['propulsion_power_w']**2
        ripple_w = r * variance_w2 / u**2
        current_a = (u - np.sqrt(u**2 - 4.0 * r * terminal_w)) / (2.0 * r)
        joule_w = r * current_a**2 + ripple_w
        leakage = self.battery.leakage
        gamma = leakage.gamma_0_w_per_k + leakage.gamma_v_w_per_k_per_mps * segment['speed_mps']
        drive = self.vehicle.drivetrain
        # The brake takes power that would be regenerated through the drivetrain.
        drivetrain_w = drive.heat_recovery_efficiency * (1.0 - drive.efficiency) * (
            segment['propulsion_power_magnitude_w'] - brake_w)
        heat_w = (self.vehicle.hvch.efficiency * heater_w + drivetrain_w + joule_w
                  + gamma * (segment['ambient_temperature_c'] - temperature_c))
        return joule_w, heat_w, terminal_w + joule_w, current_a + ripple_w / u

    def rates(self, y, segment, heater_w, brake_w=0.0):
        """Change of (soc, temperature, energy [Wh]) per second."""
        _, heat_w, power_w, current_a = self.heat_and_power(
            y[0], y[1], segment, heater_w, brake_w)
        return np.array([-current_a / (3600.0 * self.battery.capacity_ah),
                         heat_w / self.battery.heat_capacity_j_per_k, power_w / 3600.0])

    def drive(self, route, state, heater_w, brake_w=None):
        """Soc, temperature and energy [Wh] at the instants, by Runge-Kutta steps; (N + 1, 3)."""
        brake_w = np.zeros(len(route)) if brake_w is None else brake_w
        run = [np.array([state.soc, state.temperature_c, 0.0])]
        for segment, heater, brake in zip(segments_of(route), heater_w, brake_w):
            y, h = run[-1], segment['duration_s']
            k1 = self.rates(y, segment, heater, brake)
            k2 = self.rates(y + h / 2 * k1, segment, heater, brake)
            k3 = self.rates(y + h / 2 * k2, segment, heater, brake)
            k4 = self.rates(y + h * k3, segment, heater, brake)
            run.append(y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
        return np.array(run)

    def beyond_w(self, route, soc, temperature_c, heater_w, brake_w):
        """Excess of P_b over discharge and charge limit (columns) [W] at both ends of each step (rows)."""
        beyond_w = []
        for k, segment in enumerate(segments_of(route)):
            for state in zip(soc[k:k + 2], temperature_c[k:k + 2]):
                power_w = self.heat_and_power(*state, segment, heater_w[k], brake_w[k])[2]
                beyond_w.append((power_w - bilinear(self.battery.discharge_power_limit, *state),
                                 bilinear(self.battery.charge_power_limit, *state) - power_w))
        return np.array(beyond_w)

    def heater_limit_w(self, route):
        return np.maximum(self.vehicle.hvch.maximum_power_w - route.cabin_heating_power_w, 0.0)
