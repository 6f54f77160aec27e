# SPDX-License-Identifier: Apache-2.0
"""
The temperature sensor's course over a trip, and its derivatives by every parameter.

The equations are those of the project: `vehicle.variants` (rates of a drive, lags of heat and sensor),
evaluated with CasADi symbols and differentiated by CasADi.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import casadi
import numpy as np

from bev_preheat.identification.curves import CorrectedResistance, CorrectedVoltage, KNOTS_C, KNOTS_SOC
from bev_preheat.identification.electrical import Electrical
from bev_preheat.identification.parameters import NAMES, Structure
from bev_preheat.identification.readings import Readings
from bev_preheat.identification.trips import IDLE_W, Trip
from bev_preheat.nonlinear_program.symbols import SYMBOLS
from bev_preheat.numerics import AnyNumber, ARRAYS, FloatArray, IntArray
from bev_preheat.vehicle.description import DIRECT, HeatPath, Leakage, Vehicle
from bev_preheat.vehicle.model import make_rates
from bev_preheat.vehicle.variants import DriveInputs, Lagging, make_drive_rates, make_lagging_step

# Battery or core, heat under way, sensor.
STATES = 3
INPUTS = 8
# Offset, slope and curvature that correct the open-circuit voltage; the resistance over charge follows.
VOLTAGES = 3
ELECTRICAL = VOLTAGES + len(KNOTS_SOC)
PARAMETERS = len(NAMES) + len(KNOTS_C)
# Steps while the car draws power, and at stand [s].
DRIVE_STEP_S, STAND_STEP_S = 15, 300
# After parking cells and housing get equally warm within about this time [s].
SETTLING_S = 7200.0
# A signal with steps below this is continuous [K].
LEAST_RESOLUTION_K = 0.2


@dataclass(frozen=True, eq=False)
class Course:
    """A Trip in steps for the model: inputs (INPUTS, M), the Readings of K steps, and their indices (K,)."""

    trip: Trip
    inputs: FloatArray
    readings: Readings
    read: IntArray

    @property
    def settling(self) -> FloatArray | None:
        """Return the share of a difference at parking left after each step (M,); None but for nights."""
        return np.exp(-np.cumsum(self.inputs[0]) / SETTLING_S) if self.trip.kind == 'night at stand' else None

    def within_steps(self, start: FloatArray | float, after_steps: FloatArray) -> FloatArray:
        """
        Return values (K, ...) when the mean readings were taken, from those after each step (M, ...).

        `start` is the value before the first step. A reading is that at the begin of its second.
        """
        before = np.concatenate((np.broadcast_to(start, (1, *after_steps.shape[1:])), after_steps[:-1]))
        share = (0.5 - 0.5 / self.inputs[0]).reshape(-1, *[1] * (after_steps.ndim - 1))
        return np.asarray(((1.0 - share) * before + share * after_steps)[self.read])


def course_of(trip: Trip, vehicle: Vehicle) -> Course:
    """
    Return the Course of a Trip: steps of 15 s, at stand up to 300 s.

    The inputs have the mean square of the current within each step, measured if possible: the variance of the
    power gives it to first order only, several percent too low.
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
    inputs = np.stack([
        np.diff(at), power_w, trip.means(_current_a(trip, vehicle)**2, at),
        trip.means(np.abs(trip.propulsion_power_w), at), trip.means(trip.heater_w, at),
        trip.means(trip.speed_mps, at), trip.means(trip.ambient_c, at), soc])
    return Course(trip, inputs, *_readings(trip, at))


def _current_a(trip: Trip, vehicle: Vehicle) -> FloatArray:
    """Return the current (N,) [A]: measured, else that of the power with a vehicle's voltage and resistance."""
    if trip.current_a is not None:
        return trip.current_a
    nothing = np.zeros(len(trip))
    soc_rate, _, _ = make_rates(vehicle, ARRAYS)(
        trip.soc, trip.battery_temperature_c, trip.power_w + trip.heater_w, nothing, nothing, nothing)
    return np.asarray(-soc_rate * vehicle.battery.capacity_as)


def _readings(trip: Trip, edges: FloatArray) -> tuple[Readings, IntArray]:
    """Return a Trip's Readings between whole seconds `edges`, and the indices of the steps that have any."""
    seconds, end = np.diff(edges), int(edges[-1])
    weights, temperature_c = trip.weights, trip.battery_temperature_c
    if trip.reading_weight is not None:
        # Steps are whole; the reading of the end counts in the last one.
        weights, temperature_c = weights[:end].copy(), temperature_c[:end].copy()
        weights[-1] += trip.weights[end:].sum()
        temperature_c[-1] = trip.battery_temperature_c[-1]
    counts = seconds * trip.means(weights, edges)
    read = np.flatnonzero(counts > 0.0)
    if trip.resolution_k < LEAST_RESOLUTION_K:
        means_c = seconds * trip.means(weights * temperature_c, edges)
        return Readings((means_c[read] / counts[read])[:, np.newaxis], counts[read, np.newaxis], 0.0), read
    values_c, index = np.unique(temperature_c[:end], return_inverse=True)
    times = np.zeros((len(seconds), len(values_c)))
    np.add.at(times, (np.repeat(np.arange(len(seconds)), seconds.astype(int)), index), weights[:end])
    times = times[read]
    # The values of each window first, then unused places.
    order = np.argsort(-times, axis=1)[:, :int((times > 0.0).sum(axis=1).max())]
    return Readings(values_c[order], np.take_along_axis(times, order, 1), trip.resolution_k), read


class ThermalModel:
    """Sensor temperatures over courses for a START vehicle; coordinates are those of `NAMES`, then log factors."""

    def __init__(self, vehicle: Vehicle, free: Collection[str], structure: Structure) -> None:
        """Take the START vehicle; slopes over names that are not `free` are 0."""
        self._vehicle, self._structure = vehicle, structure
        self._free = [name in free for name in NAMES] + [True] * len(KNOTS_C)
        self._over: dict[int, casadi.Function] = {}

    @cached_property
    def _step(self) -> casadi.Function:
        """Return the step of states with their slopes, and the reading with its slopes as second output."""
        state, inputs, theta, electrical = (casadi.SX.sym(name, size) for name, size in (
            ('state', STATES), ('inputs', INPUTS), ('theta', PARAMETERS), ('electrical', ELECTRICAL)))
        after = self._after(*map(casadi.vertsplit, (state, inputs, theta, electrical)))
        by_state, free = casadi.jacobian(after, state), casadi.diag(casadi.DM(self._free).T)
        own = casadi.horzcat(casadi.jacobian(after, theta) @ casadi.sparsify(free), casadi.SX(STATES, 1))
        # Only slopes that can differ from 0 are carried along, which takes a third of the time.
        pattern = _start_slopes()
        for _ in range(STATES):
            pattern = pattern + casadi.DM(by_state.sparsity(), 1.0) @ pattern + casadi.DM(own.sparsity(), 1.0)
        slopes = casadi.SX.sym('slopes', pattern.sparsity())
        slopes_after = casadi.project(by_state @ slopes + own, pattern.sparsity())
        self._carried = pattern.sparsity()
        joined = casadi.vertcat(state, slopes.nz[:])
        # Without common subexpressions the step takes two thirds of the time.
        reading = casadi.densify(casadi.horzcat(after[STATES - 1], slopes_after[STATES - 1, :]))
        outputs = casadi.cse(casadi.vertcat(after, slopes_after.nz[:], reading.T))
        size = joined.numel()
        return casadi.Function('step', [joined, inputs, theta, electrical], [outputs[:size], outputs[size:].T])

    def _after(self, state: list[AnyNumber], inputs: list[AnyNumber], theta: list[AnyNumber],
               electrical: list[AnyNumber]) -> AnyNumber:
        temperature_c, under_way_k, sensor_c = state
        duration_s, power_w, square_a2, magnitude_w, heater_w, speed_mps, ambient_c, soc = inputs
        (log_capacity, log_leakage, per_speed, drivetrain_heat, efficiency, log_heat_lag, log_sensor_lag,
         shell_share, log_conductance), log_factors = theta[:len(NAMES)], theta[len(NAMES):]
        battery = self._vehicle.battery
        vehicle = replace(self._vehicle, battery=replace(battery, open_circuit_voltage=CorrectedVoltage(
            battery.open_circuit_voltage, *electrical[:VOLTAGES])))
        exp = SYMBOLS.exp
        capacity, sensor_place, heat_lag_s = exp(log_capacity), 0.0, exp(log_heat_lag)
        leakage = Leakage(exp(log_leakage), per_speed)
        if self._structure.has_shell:
            sensor_place = {'core': 0.0, 'mean': 1.0, 'shell': 1.0 / shell_share}[self._structure.sensor]
            heat_lag_s = shell_share * (1.0 - shell_share) * capacity / exp(log_conductance)
        car = replace(
            vehicle, heat_path=DIRECT, hvch=replace(vehicle.hvch, efficiency=efficiency),
            drivetrain=replace(vehicle.drivetrain, heat_recovery_efficiency=drivetrain_heat, efficiency=0.0),
            battery=replace(
                vehicle.battery, heat_capacity_j_per_k=capacity, leakage=leakage,
                resistance=CorrectedResistance(vehicle.battery.resistance, log_factors, electrical[VOLTAGES:])))
        rates, ones = make_drive_rates(car, SYMBOLS, lambda mean, variance: mean), (1.0,) * 6
        steady = DriveInputs(speed_mps, ambient_c, power_w, 0.0, magnitude_w, 0.0, 0.0, heater_w)
        # The variance with which the Joule heat is that of the current's mean square.
        steady_a2 = rates(temperature_c, soc, ones, steady)[2] / car.battery.resistance.function(SYMBOLS)(
            soc, temperature_c)
        open_v = car.battery.open_circuit_voltage.function(SYMBOLS)(soc, temperature_c)
        drive = replace(steady, power_variance_w2=(square_a2 - steady_a2) * open_v**2)

        def rates_at(core_c: AnyNumber) -> tuple[AnyNumber, AnyNumber, AnyNumber]:
            rate, soc_rate, joule_w = rates(core_c, soc, ones, drive)
            if self._structure.has_shell:
                # The air is at the shell.
                rate = rate - leakage.coefficient_w_per_k(speed_mps) * under_way_k / shell_share / capacity
                if self._structure.drivetrain_in_core:
                    joule_w = joule_w + drivetrain_heat * magnitude_w
            else:
                # All heat but the heater's arrives at once.
                joule_w = rate * capacity - efficiency * heater_w
            return rate, soc_rate, joule_w

        # Midpoint rule: the lags are solved within the step.
        middle_c = temperature_c + 0.5 * duration_s * rates_at(temperature_c)[0]
        now = rates_at(middle_c)
        sensor_lag_s = exp(log_sensor_lag)
        lagging = Lagging(
            temperature_c, soc, under_way_k, sensor_c, 0.0, heat_lag_s, sensor_lag_s,
            casadi.exp(-duration_s / heat_lag_s), casadi.exp(-duration_s / sensor_lag_s), 0.0, 0.0, sensor_place)
        car = replace(car, heat_path=HeatPath(shell_share=shell_share if self._structure.has_shell else 0.0))
        end_c, _, under_way_end_k, sensor_end_c, _ = make_lagging_step(car)(lagging, now, 1.0, duration_s)
        return casadi.vertcat(end_c, under_way_end_k, sensor_end_c)

    def course(self, course: Course, theta: FloatArray, start_c: float,
               electrical: Electrical) -> tuple[FloatArray, FloatArray]:
        """
        Return sensor temperatures after each step (M,) [deg C] and their slopes (M, PARAMETERS + 1).

        The last slope is that over the start temperature `start_c`; the open-circuit voltage, and the resistance's
        course over charge, are those of `electrical`.
        """
        steps = course.inputs.shape[1]
        if steps not in self._over:
            self._over[steps] = self._step.mapaccum('course', steps, {'base': 4})
        slopes = casadi.project(_start_slopes(), self._carried).nonzeros()
        state = np.concatenate(([start_c, 0.0, start_c], slopes))
        _, rows = self._over[steps](state, course.inputs, *(
            np.tile(values[:, np.newaxis], steps) for values in (
                theta, np.concatenate((electrical.voltage_v, electrical.soc_factors)))))
        # The rows of all steps stand side by side.
        read = rows.full().reshape(steps, PARAMETERS + 2)
        return read[:, 0], read[:, 1:]


def _start_slopes() -> casadi.DM:
    """Return the slopes of the states at the start (STATES, PARAMETERS + 1): those over the start temperature."""
    slopes = casadi.DM(STATES, PARAMETERS + 1)
    for state in (0, 2):
        slopes[state, PARAMETERS] = 1.0
    return slopes
