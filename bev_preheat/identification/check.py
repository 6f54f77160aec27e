# SPDX-License-Identifier: Apache-2.0
"""How well a vehicle file predicts recorded trips: as a plan does, and replayed to the running planner."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from bev_preheat.control.events import BatteryStateArrived, RouteArrived
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.identification.trips import Trip
from bev_preheat.numerics import FloatArray, FLOATS, NS_PER_S, S_PER_MIN, SATURATING_FLOATS
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route.segments import make_route, Route
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.heat_path import make_heated_step, sensed_c, sensor_reading_c

PREDICTION_STEP_S = 30.0


@dataclass(frozen=True, eq=False)
class Prediction:
    """Course of a trip at `time_s` (M + 1,): temperature of the sensor [deg C], state of charge."""

    time_s: FloatArray
    reading_c: FloatArray
    soc: FloatArray


def step_edges(trip: Trip) -> FloatArray:
    """Return the edges of steps of about 30 s that divide a trip evenly [s], whole seconds, shape (M + 1,)."""
    count = max(1, round(len(trip) / PREDICTION_STEP_S))
    return np.round(np.linspace(0.0, len(trip), count + 1))


def predict(vehicle: Vehicle, trip: Trip) -> Prediction:
    """Return the Prediction of a Trip with a Vehicle; it starts at the first reading."""
    edges = step_edges(trip)
    durations_s = np.diff(edges)
    power_w, magnitude_w = trip.means(trip.power_w, edges), trip.means(np.abs(trip.propulsion_power_w), edges)
    variance_w2 = np.maximum(trip.means(trip.power_w**2, edges) - power_w**2, 0.0)
    gamma = vehicle.battery.leakage.coefficient_w_per_k(trip.means(trip.speed_mps, edges))
    heat_w = gamma * trip.means(trip.ambient_c, edges) + vehicle.drivetrain.heat_to_battery_w(magnitude_w)
    step = make_heated_step(vehicle, SATURATING_FLOATS)
    temperature_c = reading_c = trip.start_c
    soc, excess_k = float(trip.soc[0]), 0.0
    courses = [(reading_c, soc)]
    for duration_s, *inputs in zip(*map(np.ndarray.tolist, (
            durations_s, power_w, variance_w2, heat_w, gamma, trip.means(trip.heater_w, edges)))):
        before_c = sensed_c(vehicle.heat_path, temperature_c, excess_k)
        # The logged heater power is the electrical one, so only the coolant delays its heat.
        soc, temperature_c, _, excess_k, *_ = step(soc, temperature_c, inputs[-1], excess_k, duration_s, *inputs)
        after_c = sensed_c(vehicle.heat_path, temperature_c, excess_k)
        reading_c = sensor_reading_c(
            vehicle.heat_path, reading_c, before_c, after_c, duration_s, SATURATING_FLOATS)
        courses.append((reading_c, soc))
    return Prediction(edges, *np.array(courses).T)


# Predictions are compared with the arrival this long before it [s].
LEADS_S = (600, 300, 120, 60)
LOG_START_NS = 10**15
# Steps of the state of charge and of the power that a car publishes.
SOC_DIGITS = 3


def route_of(trip: Trip, vehicle: Vehicle) -> Route:
    """Return the Route of a trip planner that knows the drive, in steps of 30 s."""
    edges = step_edges(trip)
    other_w = np.maximum(trip.power_w - trip.propulsion_power_w - trip.cabin_heating_power_w, 0.0)
    return make_route({
        'duration_s': np.diff(edges), 'speed_mps': trip.means(trip.speed_mps, edges),
        'propulsion_power_w': trip.means(trip.propulsion_power_w, edges),
        'propulsion_power_rms_w': np.sqrt(trip.means(trip.propulsion_power_w**2, edges)),
        'propulsion_power_magnitude_w': trip.means(np.abs(trip.propulsion_power_w), edges),
        'ambient_temperature_c': trip.means(trip.ambient_c, edges),
        'cabin_heating_power_w': trip.means(trip.cabin_heating_power_w, edges),
        'auxiliary_power_w': trip.means(other_w, edges)}, vehicle.defaults)


def replay_errors_k(vehicle: Vehicle, trip: Trip, estimation: bool) -> dict[int, float]:
    """Return predicted minus measured arrival temperature [K] by lead [s], as the node would publish it."""
    supervisor = Supervisor(vehicle, Settings(estimation=estimation))
    now_ns = LOG_START_NS
    # No target asks for heat.
    target_c = vehicle.battery.temperature_range_c[0]
    supervisor.step(now_ns, RouteArrived(Mission(
        trip.name, (Leg(route_of(trip, vehicle), now_ns, True, target_c),))))
    length, errors_k = len(trip), {}
    electrical = () if trip.voltage_v is None or trip.current_a is None else tuple(
        zip(trip.voltage_v.tolist(), trip.current_a.tolist()))
    for at, (temperature_c, soc) in enumerate(zip(trip.battery_temperature_c.tolist(), trip.soc.tolist())):
        now_ns += NS_PER_S
        supervisor.step(now_ns, BatteryStateArrived(Measurement(
            BatteryState(temperature_c, round(soc, SOC_DIGITS)), now_ns, *(electrical[at] if electrical else ()))))
        plan = supervisor.state.decision.plan
        if length - at in LEADS_S and plan is not None:
            excess_k = 0.0 if plan.heat is None else float(plan.heat.coolant_excess_k[-1])
            errors_k[length - at] = sensed_c(
                vehicle.heat_path, plan.arrival_temperature_c, excess_k) - trip.arrival_c
    return errors_k


@dataclass(frozen=True, eq=False)
class TripCheck:
    """
    A Trip, its Prediction, and the errors on arrival: predicted minus measured.

    `arrival_interval_error_k` is the distance from the interval that the arrival reading stands for [K]: 0 if the
    predicted sensor temperature rounds to the reading. `without_estimation_k` and `with_estimation_k` are the
    errors of the running planner by lead [s], empty if the trip cannot be replayed.
    """

    trip: Trip
    prediction: Prediction
    arrival_error_k: float
    arrival_interval_error_k: float
    arrival_soc_error: float
    arrival_energy_error_wh: float
    without_estimation_k: dict[int, float]
    with_estimation_k: dict[int, float]

    def as_dictionary(self) -> dict[str, Any]:
        """Return the figures in JSON form."""
        trip, predicted = self.trip, self.prediction
        without, with_it = ({str(lead_s): error_k for lead_s, error_k in errors_k.items()}
                            for errors_k in (self.without_estimation_k, self.with_estimation_k))
        return {
            'name': trip.name, 'kind': trip.kind, 'duration_s': len(trip), 'start_temperature_c': trip.start_c,
            'measured_arrival_temperature_c': trip.arrival_c,
            'predicted_arrival_temperature_c': float(predicted.reading_c[-1]),
            'arrival_error_k': self.arrival_error_k, 'arrival_interval_error_k': self.arrival_interval_error_k,
            'measured_arrival_soc': trip.arrival_soc, 'predicted_arrival_soc': float(predicted.soc[-1]),
            'arrival_soc_error': self.arrival_soc_error, 'arrival_energy_error_wh': self.arrival_energy_error_wh,
            'without_estimation_error_k': without, 'with_estimation_error_k': with_it,
            'remarks': list(trip.remarks)}


@dataclass(frozen=True, eq=False)
class Check:
    """The TripChecks of a vehicle file, and their summary."""

    vehicle: Vehicle
    trips: tuple[TripCheck, ...]

    @property
    def heated_minutes(self) -> dict[str, tuple[float, float]]:
        """Minutes in which batteries heated at stand to the end got that warm: measured and predicted, by trip."""
        return {check.trip.name: ((len(check.trip) - 1) / S_PER_MIN, _reached_s(check) / S_PER_MIN)
                for check in self.trips if check.trip.kind == 'heated at stand' and check.trip.heater_w[-2:].any()
                and check.prediction.reading_c[-1] > check.trip.start_c}

    @property
    def errors_k(self) -> list[float]:
        """Return the arrival errors [K] of all trips."""
        return [trip.arrival_error_k for trip in self.trips]

    @property
    def rmse_k(self) -> float:
        """Root mean square of the arrival errors [K]."""
        return rms(self.errors_k)

    @property
    def worst_k(self) -> float:
        """Largest arrival error [K]."""
        return max(map(abs, self.errors_k))

    @property
    def constant_rmse_k(self) -> float:
        """Root mean square error of a battery that keeps its temperature [K]."""
        return rms([check.trip.start_c - check.trip.arrival_c for check in self.trips])

    @property
    def leads(self) -> dict[int, tuple[float, float, float, float]]:
        """RMSE and worst error of the running planner by lead [s]: without estimation, then with it [K]."""
        found = {}
        for lead_s in LEADS_S:
            pairs = [(check.without_estimation_k[lead_s], check.with_estimation_k[lead_s])
                     for check in self._checks_at(lead_s)]
            if pairs:
                without, with_it = zip(*pairs)
                found[lead_s] = (rms(without), max(map(abs, without)), rms(with_it), max(map(abs, with_it)))
        return found

    def _checks_at(self, lead_s: int) -> list[TripCheck]:
        """Return the checks with both predictions at a lead [s]."""
        return [check for check in self.trips
                if lead_s in check.without_estimation_k and lead_s in check.with_estimation_k]

    @property
    def estimation_is_no_worse(self) -> bool | None:
        """
        Whether the estimation's RMSE is at most that of the file alone at each lead; None: nothing replayed.

        Of errors beyond the intervals for which the arrival readings stand: smaller differences cannot be seen.
        """
        no_worse = [
            rms([_beyond_k(check.trip, check.with_estimation_k[lead_s]) for check in checks])
            <= rms([_beyond_k(check.trip, check.without_estimation_k[lead_s]) for check in checks])
            for lead_s in LEADS_S if (checks := self._checks_at(lead_s))]
        return all(no_worse) if no_worse else None

    def as_dictionary(self) -> dict[str, Any]:
        """Return the check in JSON form."""
        return {
            'vehicle': self.vehicle.name, 'trips': [trip.as_dictionary() for trip in self.trips],
            'rmse_k': self.rmse_k, 'worst_k': self.worst_k, 'constant_temperature_rmse_k': self.constant_rmse_k,
            'heated_minutes': {name: {'measured': measured, 'predicted': predicted}
                               for name, (measured, predicted) in self.heated_minutes.items()},
            'estimation': {str(lead_s): dict(zip(
                ('without_rmse_k', 'without_worst_k', 'with_rmse_k', 'with_worst_k'), figures))
                for lead_s, figures in self.leads.items()},
            'estimation_is_no_worse': self.estimation_is_no_worse}


def check_trips(vehicle: Vehicle, trips: Sequence[Trip], replays: bool = True,
                tell: Callable[[str], None] = lambda name: None) -> Check:
    """Return the Check of a vehicle on Trips; `replays`: also as the running planner; `tell` gets each name."""
    checks = []
    for trip in trips:
        tell(trip.name)
        checks.append(_check_trip(vehicle, trip, replays))
    return Check(vehicle, tuple(checks))


def _check_trip(vehicle: Vehicle, trip: Trip, replays: bool) -> TripCheck:
    predicted = predict(vehicle, trip)
    error_k = float(predicted.reading_c[-1]) - trip.arrival_c
    soc_error = float(predicted.soc[-1]) - trip.arrival_soc
    voltage_v = vehicle.battery.open_circuit_voltage.function(FLOATS)(trip.arrival_soc, trip.arrival_c)
    # A replay can command drives without battery heating only.
    replays = replays and trip.kind == 'drive' and not trip.heats and len(trip) > LEADS_S[-1]
    without, with_it = (replay_errors_k(vehicle, trip, estimation) if replays else {}
                        for estimation in (False, True))
    return TripCheck(trip, predicted, error_k, math.copysign(_beyond_k(trip, error_k), error_k), soc_error,
                     soc_error * vehicle.battery.capacity_ah * voltage_v, without, with_it)


def _beyond_k(trip: Trip, error_k: float) -> float:
    """Return the distance of an arrival error from the interval that the reading stands for [K]."""
    return max(abs(error_k) - 0.5 * trip.resolution_k, 0.0)


def _reached_s(check: TripCheck) -> float:
    """Return when the predicted reading reaches the last measurement [s]; later it rises as before the end."""
    time_s, reading_c, end_c = check.prediction.time_s, check.prediction.reading_c, check.trip.arrival_c
    above = np.flatnonzero(reading_c >= end_c)
    at = max(int(above[0]) if len(above) else len(reading_c) - 1, 1)
    slope = (reading_c[at] - reading_c[at - 1]) / (time_s[at] - time_s[at - 1])
    return float(time_s[at] + (end_c - reading_c[at]) / slope) if slope > 0.0 else math.inf


def rms(values: Sequence[float]) -> float:
    """Return the root mean square of values, NaN without any."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else math.nan
