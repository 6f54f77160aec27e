# SPDX-License-Identifier: Apache-2.0
"""A car with constant voltage and resistance, so that currents and heat have closed forms, and its routes."""

from dataclasses import replace
import math

from bev_preheat.route import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import Drivetrain, Hvch, Leakage

HEAT_CAPACITY_J_PER_K, CAPACITY_AH, VOLTAGE_V, OHM = 361e3, 170.0, 390.0, 0.17
# The curves of the reference vehicle, and numbers that are all different.
CURVED = load_vehicle('reference')
CURVED = replace(
    CURVED, battery=replace(CURVED.battery, capacity_ah=CAPACITY_AH, heat_capacity_j_per_k=HEAT_CAPACITY_J_PER_K,
                            leakage=Leakage(gamma_0_w_per_k=31.0, gamma_v_w_per_k_per_mps=0.7)),
    drivetrain=Drivetrain(efficiency=0.88, heat_recovery_efficiency=0.6, maximum_power_w=2e5),
    hvch=Hvch(maximum_power_w=7000.0, efficiency=0.93))


def level(value):
    return Table(soc=(0.0,), temperature_c=(0.0,), values=((value,),))


LEVEL = replace(CURVED, battery=replace(
    CURVED.battery, open_circuit_voltage=level(VOLTAGE_V), resistance=level(OHM)))


def route_of(*durations_s, power_w=0.0, speed_mps=20.0, ambient_c=0.0, cabin_w=0.0, auxiliary_w=0.0, rms_w=None):
    """Return a Route with segments of these durations; a column is one value, or one for each segment."""
    return make_route({
        'duration_s': durations_s, 'propulsion_power_rms_w': rms_w, **{
            name: [values] if isinstance(values, float) else values for name, values in (
                ('speed_mps', speed_mps), ('propulsion_power_w', power_w), ('ambient_temperature_c', ambient_c),
                ('cabin_heating_power_w', cabin_w), ('auxiliary_power_w', auxiliary_w))}}, CURVED.defaults)


def current_a(power_w):
    """Return the current of a terminal power: I of U I - R I^2 = P, negative while charging."""
    return (VOLTAGE_V - math.sqrt(VOLTAGE_V**2 - 4.0 * OHM * power_w)) / (2.0 * OHM)
