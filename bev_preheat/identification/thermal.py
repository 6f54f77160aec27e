# SPDX-License-Identifier: Apache-2.0
"""
The temperature sensor's course over a trip, and its derivatives by every parameter.

The equations are those of the project: `vehicle.uncertain_car` (rates of a drive, lags of heat and sensor, local
rise), evaluated with CasADi symbols and differentiated by CasADi. Only the second mass of the structures with a
shell is added here: the core has the heat sources and the sensor, the shell has the leakage,

    C (1 - f) T' = heat - G (T - S),    C f S' = G (T - S) + gamma (T_amb - S).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import casadi
import numpy as np

from bev_preheat.estimation.state import LOCAL_LAG_S
from bev_preheat.identification.curves import CorrectedResistance, CorrectedVoltage, KNOTS_C
from bev_preheat.identification.parameters import NAMES
from bev_preheat.nonlinear_program.symbols import SYMBOLS
from bev_preheat.numerics.arithmetic import ARRAYS
from bev_preheat.vehicle.description import Leakage
from bev_preheat.vehicle.uncertain_car import DriveInputs, Lagging, make_drive_rates, make_lagging_step

if TYPE_CHECKING:
    from bev_preheat.identification.electrical import Electrical
    from bev_preheat.identification.trips import Trip
    from bev_preheat.numerics.arithmetic import AnyNumber
    from bev_preheat.numerics.arrays import FloatArray, IntArray
    from bev_preheat.vehicle.description import Vehicle

STATES = 6
INPUTS = 8
# Offset, slope and curvature that correct the open-circuit voltage.
VOLTAGES = 3
PARAMETERS = len(NAMES) + len(KNOTS_C)
# Steps while the car draws power, and at stand [s].
DRIVE_STEP_S, STAND_STEP_S = 30, 300
IDLE_W = 1000.0
# A residual each so many seconds.
READING_STEP_S = 30


@dataclass(frozen=True, eq=False)
class Course:
    """
    A Trip in steps for the model: inputs (INPUTS, M), and the steps after which readings are compared.

    `reading_at` (K,) are indices of steps, `reading_c` (K,) the readings there, `reading_weight` (K,) the time [s]
    that each stands for.
    """

    trip: Trip
    inputs: FloatArray
    reading_at: IntArray
    reading_c: FloatArray
    reading_weight_s: FloatArray


def course_of(trip: Trip, vehicle: Vehicle) -> Course:
    """
    Return the Course of a Trip: steps of 30 s, at stand up to 300 s.

    The inputs have the variance of the current within each step, measured if possible: that of the power gives
    it to
    first order only, about 5 % too low.
    """
    length = len(trip) // DRIVE_STEP_S * DRIVE_STEP_S
    fine = np.arange(0.0, length + 1.0, DRIVE_STEP_S)
    active = ((trip.means(np.abs(trip.power_w), fine) > IDLE_W) | (trip.means(trip.heater_w, fine) > 0.0)
              | (trip.means(trip.speed_mps, fine) > 0.5))
    edges, busy = [0.0], True
    for end, is_active in zip(fine[1:].tolist(), active.tolist()):
        begin = edges[-1]
        # An idle step extends the idle step before it.
        if len(edges) > 1 and not is_active and not busy and end - edges[-2] <= STAND_STEP_S:
            edges[-1] = end
        elif end > begin:
            edges.append(end)
        busy = is_active
    at = np.array(edges)
    power_w = trip.means(trip.power_w, at)
    soc = trip.means(trip.soc, at)
    if trip.current_a is None:
        open_v = vehicle.battery.open_circuit_voltage.function(ARRAYS)(soc, np.full_like(soc, trip.start_c))
        variance_a2 = (trip.means((trip.power_w + trip.heater_w)**2, at)
                       - trip.means(trip.power_w + trip.heater_w, at)**2) / open_v**2
    else:
        variance_a2 = trip.means(trip.current_a**2, at) - trip.means(trip.current_a, at)**2
    inputs = np.stack([
        np.diff(at), power_w, np.maximum(variance_a2, 0.0),
        trip.means(np.abs(trip.propulsion_power_w), at), trip.means(trip.heater_w, at),
        trip.means(trip.speed_mps, at), trip.means(trip.ambient_c, at), soc])
    compared, last_s = [], 0.0
    for index, end_s in enumerate(at[1:].tolist()):
        if end_s - last_s >= READING_STEP_S or index == len(at) - 2:
            compared.append((index, trip.battery_temperature_c[int(end_s) - 1], end_s - last_s))
            last_s = end_s
    indices, readings_c, weights_s = zip(*compared)
    return Course(trip, inputs, np.array(indices), np.array(readings_c), np.array(weights_s))


class ThermalModel:
    """
    Sensor temperatures over courses, for one START vehicle.

    Parameters (PARAMETERS,) are coordinates: those of `parameters.NAMES`, then the resistance's log factors.
    """

    def __init__(self, vehicle: Vehicle, has_shell: bool = False) -> None:
        """Take the START vehicle; the step and its derivatives are derived at first use."""
        self._vehicle = vehicle
        self._has_shell = has_shell
        self._over: dict[int, casadi.Function] = {}

    @cached_property
    def _step(self) -> casadi.Function:
        """
        Return the step of states with their slopes over parameters and start temperature.

        A second output is the reading with its slopes.
        """
        state, inputs, theta, voltage_v = (casadi.SX.sym(name, size) for name, size in (
            ('state', STATES), ('inputs', INPUTS), ('theta', PARAMETERS), ('voltage_v', VOLTAGES)))
        after = self._after(*map(casadi.vertsplit, (state, inputs, theta, voltage_v)))
        slopes = casadi.SX.sym('slopes', STATES, PARAMETERS + 1)
        own = casadi.horzcat(casadi.jacobian(after, theta), casadi.SX(STATES, 1))
        slopes_after = casadi.jacobian(after, state) @ slopes + own
        joined = casadi.vertcat(state, casadi.vec(slopes))
        return casadi.Function('step', [joined, inputs, theta, voltage_v],
                               [casadi.vertcat(after, casadi.vec(slopes_after)),
                                casadi.horzcat(after[STATES - 1], slopes_after[STATES - 1, :])]).expand()

    def _after(self, state: list[AnyNumber], inputs: list[AnyNumber], theta: list[AnyNumber],
               voltage_v: list[AnyNumber]) -> AnyNumber:
        temperature_c, shell_c, under_way_k, sensor_c, local_k, _ = state
        duration_s, power_w, variance_a2, magnitude_w, heater_w, speed_mps, ambient_c, soc = inputs
        (log_capacity, log_leakage, per_speed, drivetrain_heat, efficiency, log_heat_lag, log_sensor_lag,
         local_rise,
         shell_share, log_conductance), log_factors = theta[:len(NAMES)], theta[len(NAMES):]
        vehicle = replace(self._vehicle, battery=replace(
            self._vehicle.battery,
            open_circuit_voltage=CorrectedVoltage(self._vehicle.battery.open_circuit_voltage, *voltage_v)))
        exp = SYMBOLS.exp
        capacity, conductance = exp(log_capacity), exp(log_conductance)
        leakage = Leakage(exp(log_leakage), per_speed)
        core = capacity * (1.0 - shell_share) if self._has_shell else capacity
        car = replace(
            vehicle, hvch=replace(vehicle.hvch, efficiency=efficiency),
            drivetrain=replace(vehicle.drivetrain, heat_recovery_efficiency=drivetrain_heat, efficiency=0.0),
            battery=replace(
                vehicle.battery, heat_capacity_j_per_k=core,
                leakage=Leakage(0.0, 0.0) if self._has_shell else leakage,
                resistance=CorrectedResistance(vehicle.battery.resistance, log_factors)))
        variance_w2 = variance_a2 * vehicle.battery.open_circuit_voltage.function(SYMBOLS)(soc, temperature_c)**2
        drive = DriveInputs(speed_mps, ambient_c, power_w, variance_w2, magnitude_w, 0.0, 0.0, heater_w)
        rates = make_drive_rates(car, SYMBOLS, lambda mean, variance: mean)
        ones = (1.0,) * 5

        def rates_at(core_c: AnyNumber) -> tuple[AnyNumber, AnyNumber, AnyNumber]:
            rate, soc_rate, joule_w = rates(core_c, soc, ones, drive)
            if self._has_shell:
                rate = rate - conductance * (core_c - shell_c) / core
            return rate, soc_rate, joule_w

        # Midpoint rule: the lags are solved within the step.
        middle_c = temperature_c + 0.5 * duration_s * rates_at(temperature_c)[0]
        now = rates_at(middle_c)
        heat_lag_s, sensor_lag_s = casadi.exp(log_heat_lag), casadi.exp(log_sensor_lag)
        lagging = Lagging(
            temperature_c, soc, under_way_k, sensor_c, local_k, heat_lag_s, sensor_lag_s,
            casadi.exp(-duration_s / heat_lag_s), casadi.exp(-duration_s / sensor_lag_s),
            casadi.exp(-duration_s / LOCAL_LAG_S), 1.0, local_rise, 0.0)
        end_c, _, under_way_end_k, sensor_end_c, local_end_k = make_lagging_step(car)(
            lagging, now, heater_w, duration_s)
        shell_end_c = shell_c
        if self._has_shell:
            shell_rate = (conductance * (middle_c - shell_c) + leakage.coefficient_w_per_k(speed_mps)
                          * (ambient_c - shell_c)) / (capacity * shell_share)
            shell_end_c = shell_c + duration_s * shell_rate
        return casadi.vertcat(end_c, shell_end_c, under_way_end_k, sensor_end_c, local_end_k,
                              sensor_end_c + local_end_k)

    def course(self, course: Course, theta: FloatArray, start_c: float,
               electrical: Electrical) -> tuple[FloatArray, FloatArray]:
        """
        Return sensor temperatures after each step (M,) [deg C] and their slopes (M, PARAMETERS + 1).

        The last slope is that over the start temperature `start_c`; the open-circuit voltage is that of
        `electrical`.
        """
        steps = course.inputs.shape[1]
        if steps not in self._over:
            self._over[steps] = self._step.mapaccum('course', steps, {'base': 4})
        slopes = np.zeros((STATES, PARAMETERS + 1))
        slopes[[0, 1, 3, 5], -1] = 1.0
        state = np.concatenate(([start_c, start_c, 0.0, start_c, 0.0, start_c], slopes.ravel('F')))
        _, rows = self._over[steps](state, course.inputs, *(
            np.tile(values[:, np.newaxis], steps) for values in (theta, electrical.voltage_v)))
        # The rows of all steps stand side by side.
        read = rows.full().reshape(steps, PARAMETERS + 2)
        return read[:, 0], read[:, 1:]
