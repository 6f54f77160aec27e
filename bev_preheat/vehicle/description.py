# SPDX-License-Identifier: Apache-2.0
"""
The vehicle: everything that the model knows about one car.

Made from a YAML file by `vehicle.loading`, which checks it; nothing is checked here.
"""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Leakage:
    """Heat transfer coefficient battery-ambient [W/K]: gamma_0 + gamma_v * speed."""

    gamma_0_w_per_k: float
    gamma_v_w_per_k_per_mps: float

    def coefficient_w_per_k(self, speed_mps):
        """Gamma of eq. (3) [W/K] at a speed [m/s]; shape follows the input."""
        return self.gamma_0_w_per_k + self.gamma_v_w_per_k_per_mps * speed_mps


@dataclass(frozen=True)
class Battery:
    """
    The pack.

    Curves are those of `vehicle.curves`, over (state of charge, temperature): open-circuit voltage
    [V], internal resistance [ohm], power limits [W] (discharge positive, charge negative).
    """

    capacity_ah: float
    heat_capacity_j_per_k: float
    open_circuit_voltage: Any
    resistance: Any
    discharge_power_limit: Any
    charge_power_limit: Any
    leakage: Leakage
    soc_range: tuple
    temperature_range_c: tuple

    @property
    def capacity_as(self):
        """C_b [A s]."""
        return 3600.0 * self.capacity_ah


@dataclass(frozen=True)
class Drivetrain:
    """The electric drivetrain: efficiency eta_ed_e, share of its losses that heats the battery."""

    efficiency: float
    heat_recovery_efficiency: float
    maximum_power_w: float

    @property
    def heat_share(self):
        """Part of the magnitude of the propulsion power that reaches the battery as heat."""
        return self.heat_recovery_efficiency * (1.0 - self.efficiency)

    def heat_to_battery_w(self, propulsion_power_w):
        """
        Q_ed of eq. (5) [W]; shape follows the input.

        The paper's equation is signed, so that braking would cool the battery; a loss is positive
        both ways, so the magnitude is taken.
        """
        return self.heat_share * abs(propulsion_power_w)


@dataclass(frozen=True)
class Hvch:
    """The high-voltage coolant heater: electrical maximum [W] and efficiency to battery heat."""

    maximum_power_w: float
    efficiency: float


@dataclass(frozen=True)
class Defaults:
    """What holds where a route or a driver says nothing."""

    cabin_heating_power_w: float
    auxiliary_power_w: float
    target_battery_temperature_c: float


@dataclass(frozen=True, eq=False)
class Vehicle:
    """One car; compared by identity, so that what is made from one can be kept beside it."""

    name: str
    battery: Battery
    drivetrain: Drivetrain
    hvch: Hvch
    defaults: Defaults
