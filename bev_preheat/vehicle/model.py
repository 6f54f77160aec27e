# SPDX-License-Identifier: Apache-2.0
"""
The model's differential equations, their integration and their inputs along a trip, for every kind of number.

States: state of charge (0 ... 1) and battery temperature [deg C]; equations (1)-(5) and (9b)-(9d).
The inputs of a step are constant within it and are those of `planning.trip.Trip`:

    terminal_power_w   P_t: drivetrain, cabin, auxiliaries and HVCH
    power_variance_w2  mean square minus squared mean of the propulsion power
        heat_w             eta_hvch P_hvch_b + gamma T_amb + Q_ed: the heat that does not depend on the state
    leakage_w_per_k    gamma

The terms of the heat balance, and everything made by `make_…`, are also the source of the core's C
(`bev_preheat.code_generation.c_source`). `make_rates` takes an `arithmetic.Arithmetic`, so the same code serves
plain floats (planning), arrays (a whole trajectory at once) and CasADi symbols (the NLP).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol, Self

import numpy as np

from bev_preheat.numerics import AnyNumber, Arithmetic, FloatArray, Number
from bev_preheat.tunables import HOTTEST_BEYOND_RANGE_K
from bev_preheat.vehicle.description import Vehicle

# In this order they lie in the block; the first has one value more than there are steps.
TRIP_COLUMNS = ('time_s', 'duration_s', 'idle_power_w', 'power_variance_w2', 'idle_heat_w',
                'leakage_w_per_k', 'heater_limit_w', 'propulsion_power_w', 'drivetrain_heat_w',
                'ambient_temperature_c')


@dataclass(frozen=True, eq=False)
class TripColumns:
    """TRIP_COLUMNS one after the other in a `block`: the first (N + 1,), the others (N,), of so many `steps`."""

    steps: int
    block: FloatArray

    @classmethod
    def of_columns(cls, *columns: FloatArray) -> Self:
        """Return the columns of a trip, given in their order."""
        return cls(len(columns[1]), np.concatenate(columns, dtype=float))

    def changed(self, **columns: FloatArray) -> Self:
        """Return the columns of a trip with others, by name."""
        if unknown := columns.keys() - TRIP_COLUMNS:
            raise TypeError(f'{", ".join(sorted(unknown))}: not columns of a trip')
        return self.of_columns(*{**dict(zip(TRIP_COLUMNS, map(self.column, TRIP_COLUMNS))), **columns}.values())

    def column(self, name: str) -> FloatArray:
        """Return a column, as a part of the block."""
        number, steps = TRIP_COLUMNS.index(name), self.steps
        end = 1 + (number + 1) * steps
        return self.block[end - steps if number else 0:end]


def heat_with_heater_w(vehicle: Vehicle, heat_w: AnyNumber, heater_w: AnyNumber) -> AnyNumber:
    """Return the heat into the battery [W] with that of an HVCH power [W]; shape of the inputs together."""
    return heat_w + vehicle.hvch.efficiency * heater_w


def heat_with_brake_w(vehicle: Vehicle, heat_w: AnyNumber, brake_w: AnyNumber) -> AnyNumber:
    """Return the heat into the battery [W] without that of regeneration which the friction brake takes [W]."""
    return heat_w - vehicle.drivetrain.heat_share * brake_w


def heat_under_w(vehicle: Vehicle, heat_w: AnyNumber, heater_w: AnyNumber, brake_w: AnyNumber) -> AnyNumber:
    """Return the heat into the battery [W] under an HVCH and a friction brake power [W]."""
    return heat_with_brake_w(vehicle, heat_with_heater_w(vehicle, heat_w, heater_w), brake_w)


def leaked_w(leakage_w_per_k: AnyNumber, ambient_c: AnyNumber, temperature_c: AnyNumber) -> AnyNumber:
    """Return the heat from the ambient air [W], gamma (T_amb - T_b) of eq. (3); negative: heat is lost."""
    return leakage_w_per_k * (ambient_c - temperature_c)


def deliverable_w(voltage_v: AnyNumber, resistance_ohm: AnyNumber) -> AnyNumber:
    """Return the most terminal power [W] that the circuit can give, U_oc^2/(4 R)."""
    return voltage_v * voltage_v / (4.0 * resistance_ohm)


def idle_power_w(propulsion_w: AnyNumber, cabin_w: AnyNumber, auxiliary_w: AnyNumber) -> AnyNumber:
    """Return the terminal power without battery heating [W]."""
    return propulsion_w + cabin_w + auxiliary_w


def idle_heat_w(leakage_w_per_k: AnyNumber, ambient_c: AnyNumber, drivetrain_heat_w: AnyNumber) -> AnyNumber:
    """Return gamma T_amb + Q_ed [W]: what without battery heating does not depend on the battery's state."""
    return leakage_w_per_k * ambient_c + drivetrain_heat_w


# Cached per vehicle and kind of number: nominal and corrected vehicles of several cars.
KEPT_LIMITS = 64

TerminalLimits = Callable[[Number, Number, Number], tuple[Number, Number]]


@lru_cache(maxsize=KEPT_LIMITS)
def make_terminal_limits(vehicle: Vehicle, arithmetic: Arithmetic[Number]) -> TerminalLimits[AnyNumber]:
    """
    Return `limits(soc, temperature_c, power_variance_w2)` -> least and most terminal power [W].

    With P_b = U I + R var/U^2 at its limit, P_t = U I - R I^2. The upper limit is at most the value at
    I = U/(2 R), whatever the battery's own limit.
    """
    battery = vehicle.battery
    open_circuit_voltage = battery.open_circuit_voltage.function(arithmetic)
    resistance = battery.resistance.function(arithmetic)
    charge = battery.charge_power_limit.function(arithmetic)
    discharge = battery.discharge_power_limit.function(arithmetic)
    minimum = arithmetic.minimum

    def limits(soc: Number, temperature_c: Number, power_variance_w2: Number) -> tuple[Number, Number]:
        u = open_circuit_voltage(soc, temperature_c)
        r = resistance(soc, temperature_c)
        ripple_w = r * power_variance_w2 / (u * u)
        charging_a = (charge(soc, temperature_c) - ripple_w) / u
        discharging_a = minimum((discharge(soc, temperature_c) - ripple_w) / u, 0.5 * u / r)
        return (u * charging_a - r * charging_a * charging_a,
                u * discharging_a - r * discharging_a * discharging_a)

    return limits


def hottest_c(vehicle: Vehicle) -> float:
    """Return the hottest temperature in planning [deg C]: a car's cooling, not modelled, holds it there."""
    return vehicle.battery.temperature_range_c[1] + HOTTEST_BEYOND_RANGE_K


# `rates(soc, temperature_c, power_w, variance_w2, heat_w, leakage_w_per_k)`.
Rates = Callable[[Number, Number, Number, Number, Number, Number], tuple[Number, Number, Number]]
# `step(soc, temperature_c, dt_s, power_w, variance_w2, heat_w, leakage_w_per_k)`.
Step = Callable[[Number, Number, Number, Number, Number, Number, Number], tuple[Number, Number, Number, Number]]


class Integrator(Protocol):
    """One of the integration methods in this module."""

    def __call__(self, rates: Rates[Number], /) -> Step[Number]:
        """Return one step of the method."""

    def __hash__(self) -> int:
        """Return a hash, because steps are cached by method."""


def make_rates(vehicle: Vehicle, arithmetic: Arithmetic[Number]) -> Rates[Number]:
    """
    Return the right-hand side of eqs. (9b)-(9d): `rates(soc, temperature_c, *inputs)`.

    Returns (d soc/dt [1/s], dT/dt [K/s], Joule heat [W]).

    The current solves U_oc I - R I^2 = P_t. Power that varies within the step adds R var/U_oc^2 to the Joule heat
    (the variance of the current, to first order) and R var/U_oc^3 to the mean current that supplies it, so that
    P_b = U_oc I_b = P_t + Q_Joule holds exactly; with constant power both vanish and eq. (4) remains.

    If 4 R P_t > U_oc^2 the power cannot be delivered: floats raise ValueError with
    `arithmetic.FLOATS`; other kinds of number limit the current to U_oc/(2 R).
    """
    battery = vehicle.battery
    open_circuit_voltage = battery.open_circuit_voltage.function(arithmetic)
    resistance = battery.resistance.function(arithmetic)
    root = arithmetic.root
    per_capacity_as = 1.0 / battery.capacity_as
    per_heat_capacity = 1.0 / battery.heat_capacity_j_per_k

    def rates(soc: Number, temperature_c: Number, terminal_power_w: Number,
              power_variance_w2: Number, heat_w: Number,
              leakage_w_per_k: Number) -> tuple[Number, Number, Number]:
        u = open_circuit_voltage(soc, temperature_c)
        r = resistance(soc, temperature_c)
        u2 = u * u
        # R I, of the smaller root
        drop_v = 0.5 * (u - root(u2 - 4.0 * r * terminal_power_w))
        current_a = drop_v / r
        # R var/U_oc^2
        ripple_w = r * power_variance_w2 / u2
        joule_w = drop_v * current_a + ripple_w
        return (
            -(current_a + ripple_w / u) * per_capacity_as,
            (heat_w - leakage_w_per_k * temperature_c + joule_w) * per_heat_capacity,
            joule_w,
        )

    return rates


def stage_mean(first: Number, second: Number, third: Number, fourth: Number) -> Number:
    """Return the mean over a step of the classical Runge-Kutta method from its values at the four stages."""
    return (first + 2.0 * (second + third) + fourth) / 6.0


def make_runge_kutta_4(rates: Rates[Number], mean: Callable[..., AnyNumber] = stage_mean) -> Step[Number]:
    """
    Return one step of the classical Runge-Kutta method: `step(soc, temperature_c, dt_s, *inputs)`.

    Returns (soc, temperature [deg C] at the end, mean temperature [deg C], mean Joule heat [W]);
    the means use the method's own weights, so the step's heat balance closes to rounding. `mean` takes the third
    result of `rates` at the four stages, if it is not a number.
    """
    def step(soc: Number, temperature_c: Number, dt_s: Number, power_w: Number,
             variance_w2: Number, heat_w: Number,
             leakage_w_per_k: Number) -> tuple[Number, Number, Number, Number]:
        half = 0.5 * dt_s
        s1, t1, j1 = rates(soc, temperature_c, power_w, variance_w2, heat_w, leakage_w_per_k)
        s2, t2, j2 = rates(soc + half * s1, temperature_c + half * t1,
                           power_w, variance_w2, heat_w, leakage_w_per_k)
        s3, t3, j3 = rates(soc + half * s2, temperature_c + half * t2,
                           power_w, variance_w2, heat_w, leakage_w_per_k)
        s4, t4, j4 = rates(soc + dt_s * s3, temperature_c + dt_s * t3,
                           power_w, variance_w2, heat_w, leakage_w_per_k)
        sixth = dt_s / 6.0
        return (
            soc + sixth * (s1 + 2.0 * (s2 + s3) + s4),
            temperature_c + sixth * (t1 + 2.0 * (t2 + t3) + t4),
            temperature_c + sixth * (t1 + t2 + t3),
            mean(j1, j2, j3, j4),
        )

    return step


def make_euler(rates: Rates[Number]) -> Step[Number]:
    """Return one step of the explicit Euler method, as printed in Algorithm 1; results as for Runge-Kutta."""
    def step(soc: Number, temperature_c: Number, dt_s: Number, power_w: Number,
             variance_w2: Number, heat_w: Number,
             leakage_w_per_k: Number) -> tuple[Number, Number, Number, Number]:
        soc_rate, temperature_rate, joule_w = rates(
            soc, temperature_c, power_w, variance_w2, heat_w, leakage_w_per_k)
        return (soc + dt_s * soc_rate, temperature_c + dt_s * temperature_rate, temperature_c, joule_w)

    return step


def make_midpoint(rates: Rates[Number]) -> Step[Number]:
    """Return one step of the explicit midpoint method, of second order; results as for Runge-Kutta."""
    def step(soc: Number, temperature_c: Number, dt_s: Number, power_w: Number,
             variance_w2: Number, heat_w: Number,
             leakage_w_per_k: Number) -> tuple[Number, Number, Number, Number]:
        half = 0.5 * dt_s
        s1, t1, _ = rates(soc, temperature_c, power_w, variance_w2, heat_w, leakage_w_per_k)
        middle_c = temperature_c + half * t1
        s2, t2, joule_w = rates(soc + half * s1, middle_c, power_w, variance_w2, heat_w, leakage_w_per_k)
        return soc + dt_s * s2, temperature_c + dt_s * t2, middle_c, joule_w

    return step
