# SPDX-License-Identifier: Apache-2.0
"""The simulated vehicle: drives a route and heats its battery as commanded."""

from __future__ import annotations

from math import ceil, exp
from typing import NamedTuple

from bev_preheat.charging.equations import CoolingPowers
from bev_preheat.numerics import FLOATS, JOULES_PER_WH, SATURATING_FLOATS
from bev_preheat.planning.dynamics import deliverable_power_w, Energies, step_of_floats
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.trip import make_trip, Trip
from bev_preheat.route.segments import Route
from bev_preheat.simulation.heater import HeaterLease, SimulatedSources
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.heat_path import HeatedStep, make_heated_step, sensed_c, sensor_reading_c
from bev_preheat.vehicle.model import (
    heat_under_w,
    heat_with_brake_w,
    hottest_c,
    make_rates,
    make_runge_kutta_4,
    make_terminal_limits,
    Rates,
    Step,
    TerminalLimits,
)
from bev_preheat.vehicle.variants import hvch_alone

LONGEST_PLANT_STEP_S = 1.0
# Of the time constant between shell and core.
LONGEST_SHELL_STEP = 0.05


class _Segment(NamedTuple):
    """One step of a Trip as floats, because arrays cost more than the arithmetic of a single step."""

    idle_power_w: float
    variance_w2: float
    idle_heat_w: float
    leakage_w_per_k: float
    drivetrain_heat_w: float
    heater_limit_w: float
    propulsion_power_w: float
    ambient_c: float


def _segments_of(trip: Trip) -> list[_Segment]:
    columns = (trip.idle_power_w, trip.power_variance_w2, trip.idle_heat_w, trip.leakage_w_per_k,
               trip.drivetrain_heat_w, trip.heater_limit_w, trip.route.propulsion_power_w,
               trip.route.ambient_temperature_c)
    return [_Segment(*values) for values in zip(*(column.tolist() for column in columns))]


class VehiclePlant:
    """
    State of charge (0 ... 1) and battery temperature [deg C] of a vehicle on its way.

    Integrates `model` in steps of at most LONGEST_PLANT_STEP_S that end at the segments' boundaries,
    finer than the plans under test. The route starts at the instant `start_s`; `time_s`
    is the present instant. At the end of the route, or with an empty battery, the vehicle stands: its
    time goes on, state and sums stay. Cabin and battery have priority: the heater gets the remaining power,
    and regeneration beyond the battery's limit goes into the friction brake.

    `heater_power_w`, `brake_power_w` and `cooling_power_w` are their actual powers [W]; `sources` heat beside the
    HVCH. `coolant_c` and `sensor_c` are the temperatures [deg C] of the coolant between heater and
    battery and of the sensor, if the vehicle has a `heat_path` (else that of the battery); with a shell,
    `coolant_c` is the shell's and `temperature_c` the core's. `terminal_voltage_v` and `current_a` are the mean
    values at the battery's terminals (positive = discharging, 0 while the vehicle stands), `undeliverable_power_w`
    is the largest power deficit of the battery so far [W], `empty_at_s` the instant at which it ran empty [s],
    None if it did not, and `without_lease_s` the driving time without a valid command [s].
    """

    def __init__(self, vehicle: Vehicle, route: Route, state: BatteryState, start_s: float = 0.0,
                 cooling: CoolingPowers | None = None) -> None:
        """Put a vehicle at the start of a route at an instant [s]; `cooling`: of a car at a charger."""
        self.vehicle, self.start_s = vehicle, start_s
        # The trip divides segments that are too long for one step.
        trip = make_trip(hvch_alone(vehicle), route)
        self.route = trip.route
        self.time_s = start_s
        # The native core counts from the start of the route.
        self._elapsed_s = 0.0
        self.soc = state.soc
        self.temperature_c = state.temperature_c
        self.coolant_c = state.temperature_c + state.coolant_excess_k
        self.sensor_c = self._sensed_c()
        self.heater_power_w = self.cooling_power_w = self._cooled_w = 0.0
        self._cooling, self.sources = cooling, SimulatedSources(vehicle)
        self._command_w, self._power_at_end_w = 0.0, state.heater_power_w
        # Cached, because building a step costs more than running it. The second one is for a power deficit.
        self._is_direct, self._has_coolant = vehicle.heat_path.is_direct, vehicle.heat_path.has_coolant
        self._steps: tuple[Step[float], Step[float]] = (
            step_of_floats(vehicle, make_runge_kutta_4),
            step_of_floats(vehicle, make_runge_kutta_4, saturating=True))
        self._heated_steps: tuple[HeatedStep[float], HeatedStep[float]] = (
            make_heated_step(vehicle, FLOATS), make_heated_step(vehicle, SATURATING_FLOATS))
        self._rates: Rates[float] = make_rates(vehicle, SATURATING_FLOATS)
        self._circuits = make_rates(vehicle, FLOATS), self._rates
        self._voltage, self._resistance = (
            curve.function(SATURATING_FLOATS)
            for curve in (vehicle.battery.open_circuit_voltage, vehicle.battery.resistance))
        self._highest_c, self._hottest_c = vehicle.battery.temperature_range_c[1], hottest_c(vehicle)
        self.brake_power_w = 0.0
        self.undeliverable_power_w = 0.0
        self.empty_at_s: float | None = None
        self.without_lease_s = 0.0
        self._ends_s: list[float] = self.route.time_s[1:].tolist()
        self._segments = _segments_of(trip)
        self._segment = 0
        self._joule_j = self._drivetrain_j = self._heater_j = self._leakage_j = 0.0
        self._battery_j = self._undeliverable_j = self._brake_j = 0.0
        self._terminal_limits: TerminalLimits[float] = make_terminal_limits(
            vehicle, SATURATING_FLOATS)
        self.terminal_voltage_v = self.current_a = 0.0
        self._look_at_terminals()

    @property
    def duration_s(self) -> float:
        """Duration of the route [s]."""
        return self._ends_s[-1]

    @property
    def speed_mps(self) -> float:
        """Speed of the current segment [m/s]; 0 once the vehicle stands."""
        return 0.0 if self.is_standing else float(self.route.speed_mps[self._segment])

    @property
    def has_arrived(self) -> bool:
        """Whether the route has ended."""
        return self._segment == len(self._ends_s)

    @property
    def is_standing(self) -> bool:
        """Whether the vehicle has stopped for good: arrived, or with an empty battery."""
        return self.has_arrived or self.empty_at_s is not None

    @property
    def end_s(self) -> float:
        """End of the drive, as far as known [s]."""
        return self.start_s + self.duration_s if self.empty_at_s is None else self.empty_at_s

    def followed_by(self, vehicle: Vehicle, route: Route, cooling: CoolingPowers | None = None) -> VehiclePlant:
        """Return the plant, with its heater on, that continues as another Vehicle on another Route; sums are 0."""
        following = VehiclePlant(vehicle, route, BatteryState(
            self.temperature_c, self.soc, self._power_at_end_w, self.coolant_c - self.temperature_c),
            self.time_s, cooling)
        following.sensor_c = self.sensor_c
        following.sources.go_on_from(self.sources)
        return following

    def advance(self, to_s: float, heater_power_w: float) -> None:
        """Drive on to `to_s` [s] with a heater power [W], within the limits."""
        # Rounding of the difference must not leave the last segment unfinished.
        until_s = max(to_s - self.start_s, self.duration_s if to_s >= self.end_s else 0.0)
        self._drive(until_s, heater_power_w)
        self._look_at_terminals()
        if self.is_standing:
            self.heater_power_w = self.brake_power_w = self.cooling_power_w = self._cooled_w = 0.0
            if self.empty_at_s is not None:
                self._power_at_end_w = 0.0
            self.sources.off()
        self._elapsed_s, self.time_s = until_s, to_s

    def advance_under(self, lease: HeaterLease, to_s: float, uncommanded_w: float | None = None) -> None:
        """
        Drive on to `to_s` [s] with the powers of a HeaterLease, and 0 W after its end.

        The HVCH takes `uncommanded_w` [W] whatever the lease; None: as the lease says.
        """
        if self.time_s < lease.until_s:
            self.sources.commands_w = lease.sources_w
            self.advance(min(to_s, lease.until_s), lease.power_w if uncommanded_w is None else uncommanded_w)
            self.sources.commands_w = {}
        if self.time_s < to_s:
            since_s = self.time_s
            self.advance(to_s, uncommanded_w or 0.0)
            if uncommanded_w is None:
                self.without_lease_s += max(0.0, min(to_s, self.end_s) - since_s)

    def _drive(self, until_s: float, heater_power_w: float) -> None:
        while self._elapsed_s < until_s and not self.is_standing:
            end_s = self._ends_s[self._segment]
            self._drive_within_segment(min(until_s, end_s), heater_power_w)
            if self._elapsed_s == end_s and self.empty_at_s is None:
                self._segment += 1

    def _drive_within_segment(self, until_s: float, heater_power_w: float) -> None:
        steps = ceil((until_s - self._elapsed_s) / LONGEST_PLANT_STEP_S)
        step_s = (until_s - self._elapsed_s) / steps
        for _ in range(steps):
            self._keep_limits(heater_power_w)
            self._step(step_s)
            if self.soc == 0.0:
                self.empty_at_s = self.start_s + self._elapsed_s
                return
        # Sums of steps miss the end by rounding.
        self._elapsed_s = until_s

    def _keep_limits(self, wanted_w: float) -> None:
        """Limit heater command and friction brake to the power left by cabin and battery; `wanted_w` [W]."""
        segment = self._segments[self._segment]
        idle_w = segment.idle_power_w
        least_w, most_w = self._terminal_limits(self.soc, self.temperature_c, segment.variance_w2)
        self._command_w = max(0.0, min(wanted_w, segment.heater_limit_w, most_w - idle_w))
        is_shell = self.vehicle.heat_path.is_shell
        is_hot = (max(self.temperature_c, self.coolant_c) if is_shell else self.temperature_c) >= self._highest_c
        if is_hot:
            self._command_w = 0.0
        # The power of a lagging heater cannot be changed at once.
        self.heater_power_w = self._command_w if self._is_direct else self._power_at_end_w
        if self.sources:
            self.sources.heat(
                segment.ambient_c, self.temperature_c, self.speed_mps,
                float(self.route.cabin_heating_power_w[self._segment]), most_w - idle_w - self._command_w, is_hot)
        if self._cooling is not None:
            self.cooling_power_w, self._cooled_w = self._cooling(
                self.temperature_c, max(0.0, -idle_w - self.heater_power_w))
        regenerated_w = max(0.0, -segment.propulsion_power_w)
        drawn_w = self.heater_power_w + self.sources.drawn_w + self.cooling_power_w
        self.brake_power_w = min(regenerated_w, max(0.0, least_w - idle_w - drawn_w))

    def _inputs(self, heater_power_w: float) -> tuple[float, float, float, float]:
        """Return power, power variance, heat and leakage of a step under a heater power [W]; as Trip.inputs."""
        segment = self._segments[self._segment]
        power_w = segment.idle_power_w + heater_power_w + self.brake_power_w + self.cooling_power_w
        return (power_w + self.sources.drawn_w, segment.variance_w2,
                heat_under_w(self.vehicle, segment.idle_heat_w - self._cooled_w,
                             heater_power_w + self.sources.heat_w, self.brake_power_w),
                segment.leakage_w_per_k)

    def _sensed_c(self) -> float:
        """Return the temperature at the sensor's place [deg C]."""
        excess_k = self.coolant_c - self.temperature_c
        place_c: float = sensed_c(self.vehicle.heat_path, self.temperature_c, excess_k)
        return place_c

    def _two_masses_step(self, step_s: float, saturating: bool) -> tuple[float, float, float, float]:
        """Return `_model_step` for core and shell: midpoint steps, as a check of `vehicle.heat_path`."""
        path, core_j_per_k = self.vehicle.heat_path, self.vehicle.battery.heat_capacity_j_per_k
        shell_j_per_k, conductance = path.coolant_heat_capacity_j_per_k, path.coolant_conductance_w_per_k
        parts = ceil(step_s * conductance * (1.0 / shell_j_per_k + 1.0 / core_j_per_k) / LONGEST_SHELL_STEP)
        part_s = step_s / parts
        heater_left = exp(-part_s / path.heater_lag_s) if path.heater_lag_s > 0.0 else 0.0
        soc, core_c, shell_c = self.soc, self.temperature_c, self.coolant_c
        heater_w = self._power_at_end_w if path.heater_lag_s > 0.0 else self._command_w
        drawn_w = shell_sum_c = joule_sum_w = 0.0
        for _ in range(parts):
            heater_end_w = self._command_w + (heater_w - self._command_w) * heater_left
            power_w, variance_w2, heat_w, leakage_w_per_k = self._inputs(0.5 * (heater_w + heater_end_w))
            rate, core_rate, shell_rate, joule_w = 0.0, 0.0, 0.0, 0.0
            for ahead_s in (0.0, 0.5 * part_s):
                core_now_c, shell_now_c = core_c + ahead_s * core_rate, shell_c + ahead_s * shell_rate
                rate, _, joule_w = self._circuits[saturating](
                    soc + ahead_s * rate, core_now_c, power_w, variance_w2, 0.0, 0.0)
                passed_w = conductance * (shell_now_c - core_now_c)
                core_rate = (passed_w + joule_w) / core_j_per_k
                shell_rate = (heat_w - leakage_w_per_k * shell_now_c - passed_w) / shell_j_per_k
            soc, core_c, shell_c = soc + part_s * rate, core_c + part_s * core_rate, shell_c + part_s * shell_rate
            drawn_w += 0.5 * (heater_w + heater_end_w) / parts
            shell_sum_c, joule_sum_w, heater_w = shell_sum_c + shell_now_c, joule_sum_w + joule_w, heater_end_w
        self.heater_power_w, self._power_at_end_w, self.coolant_c = drawn_w, heater_w, shell_c
        return soc, core_c, shell_sum_c / parts, joule_sum_w / parts

    def _model_step(self, step_s: float, saturating: bool) -> tuple[float, float, float, float]:
        """Return the result of the model's step; advance heater and coolant with it."""
        if self.vehicle.heat_path.is_shell:
            return self._two_masses_step(step_s, saturating)
        if self._is_direct:
            return self._steps[saturating](
                self.soc, self.temperature_c, step_s, *self._inputs(self.heater_power_w))
        # The heat of all sources takes the path of the HVCH's.
        others_w = self.sources.heat_w
        soc, temperature_c, end_w, excess_k, mean_temperature_c, joule_w, drawn_w, _ = (
            self._heated_steps[saturating](
                self.soc, self.temperature_c, self._power_at_end_w,
                self.coolant_c - self.temperature_c, step_s, *self._inputs(-others_w), self._command_w + others_w))
        self.heater_power_w, self._power_at_end_w = drawn_w - others_w, end_w
        self.coolant_c = temperature_c + excess_k
        return soc, temperature_c, mean_temperature_c, joule_w

    def _step(self, step_s: float) -> None:
        segment = self._segments[self._segment]
        deficit_w, sensed_c = 0.0, self._sensed_c()
        try:
            soc, temperature_c, mean_temperature_c, joule_w = self._model_step(
                step_s, saturating=False)
            power_w = self._inputs(self.heater_power_w)[0]
        except ValueError:
            soc, temperature_c, mean_temperature_c, joule_w = self._model_step(
                step_s, saturating=True)
            power_w = self._inputs(self.heater_power_w)[0]
            deficit_w = max(0.0, power_w - float(
                deliverable_power_w(self.vehicle, self.soc, self.temperature_c)))
        # The charge stops at 0 and 1, and a car stops its battery from getting any hotter.
        self.soc = min(max(soc, 0.0), 1.0)
        self.temperature_c = min(temperature_c, self._hottest_c)
        if not self._has_coolant:
            self.coolant_c = self.temperature_c
        self.sensor_c = sensor_reading_c(
            self.vehicle.heat_path, self.sensor_c, sensed_c, self._sensed_c(), step_s,
            SATURATING_FLOATS)
        cooled_j = self.vehicle.battery.heat_capacity_j_per_k * (temperature_c - self.temperature_c)
        self._elapsed_s += step_s
        self.undeliverable_power_w = max(self.undeliverable_power_w, deficit_w)
        drivetrain_heat_w = heat_with_brake_w(
            self.vehicle, segment.drivetrain_heat_w, self.brake_power_w)
        self._joule_j += step_s * joule_w
        self._drivetrain_j += step_s * drivetrain_heat_w
        self._heater_j += step_s * self.heater_power_w
        self.sources.count(step_s)
        self._leakage_j += (
            step_s * segment.leakage_w_per_k * (segment.ambient_c - mean_temperature_c)
            - step_s * self._cooled_w - cooled_j)
        self._battery_j += step_s * (power_w - deficit_w + joule_w)
        self._undeliverable_j += step_s * deficit_w
        self._brake_j += step_s * self.brake_power_w

    def _look_at_terminals(self) -> None:
        self.current_a = 0.0
        if not self.is_standing:
            soc_rate, _, _ = self._rates(
                self.soc, self.temperature_c, *self._inputs(self.heater_power_w))
            self.current_a = -soc_rate * self.vehicle.battery.capacity_as
        self.terminal_voltage_v = (
            self._voltage(self.soc, self.temperature_c)
            - self._resistance(self.soc, self.temperature_c) * self.current_a)

    @property
    def energy_wh(self) -> Energies:
        """Energies of what really happened so far [Wh]."""
        return Energies(
            joule=self._joule_j / JOULES_PER_WH,
            drivetrain_heat=self._drivetrain_j / JOULES_PER_WH,
            hvch_heat=self.vehicle.hvch.efficiency * (self._heater_j + self.sources.heat_j) / JOULES_PER_WH,
            leakage=self._leakage_j / JOULES_PER_WH,
            hvch_electric=self._heater_j / JOULES_PER_WH + sum(self.sources.energy_wh.values()),
            battery_total=self._battery_j / JOULES_PER_WH)

    @property
    def undeliverable_energy_wh(self) -> float:
        """Energy requested by the route that the battery could not deliver [Wh]."""
        return self._undeliverable_j / JOULES_PER_WH

    @property
    def friction_brake_energy_wh(self) -> float:
        """Energy that the battery could not absorb, taken by the friction brakes [Wh]."""
        return self._brake_j / JOULES_PER_WH
