# SPDX-License-Identifier: Apache-2.0
"""A car of formulas with its numbers written out, because the shipped car's are fitted and may change."""

from dataclasses import replace

import numpy as np

from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import InverseTemperatureResistance, PolynomialVoltage
from bev_preheat.vehicle.description import Drivetrain, Hvch, Leakage

SHIPPED_CAR = load_vehicle('reference')
FORMULA_CAR = replace(
    SHIPPED_CAR,
    battery=replace(
        SHIPPED_CAR.battery, capacity_ah=200.0, heat_capacity_j_per_k=378500.0,
        open_circuit_voltage=PolynomialVoltage((365.0, 75.0, 0.0, 15.0)),
        resistance=InverseTemperatureResistance(4.2, 45.0), leakage=Leakage(33.0, 0.5),
        soc_range=(0.05, 1.0), temperature_range_c=(-40.0, 60.0)),
    drivetrain=Drivetrain(0.9, 0.8, 350e3), hvch=Hvch(7000.0, 0.87))


def with_limits(discharge, charge):
    return replace(FORMULA_CAR, battery=replace(
        FORMULA_CAR.battery, discharge_power_limit=discharge, charge_power_limit=charge))


def voltage_v(soc):
    return 365.0 + 75.0 * soc + 15.0 * soc**3


def resistance_ohm(temperature_c):
    return 4.2 / (temperature_c + 45.0)


def current_a(soc, temperature_c, terminal_w):
    """Return the smaller root of U I - R I^2 = P_t [A]; at the circuit's most power beyond that."""
    u, r = voltage_v(soc), resistance_ohm(temperature_c)
    return (u - np.sqrt(np.maximum(u**2 - 4 * r * terminal_w, 0.0))) / (2 * r)
