# SPDX-License-Identifier: Apache-2.0
"""
Estimates the battery's state and the model's corrections from the stream of battery states.

Instants are integers, in nanoseconds of the clock that stamps the battery states.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
import math
from typing import Protocol, TYPE_CHECKING

import numpy as np

from bev_preheat.estimation.belief import Belief
from bev_preheat.estimation.hypotheses import HeaterReport, judge
from bev_preheat.estimation.power_response import PowerResponse
from bev_preheat.estimation.resolution import Resolution, SOC_STEPS, TEMPERATURE_STEPS_K
from bev_preheat.estimation.state import DriveInputs, FACTORS, PROPULSION, SOC, TEMPERATURE
from bev_preheat.vehicle.corrections import Corrections

if TYPE_CHECKING:
    from bev_preheat.arrays import FloatArray
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.vehicle.description import Vehicle

NS_PER_S = 1_000_000_000
# Readings that follow faster are not independent of each other: one a second is taken.
LEAST_INTERVAL_S = 0.95
# The belief is moved in steps of at most this.
LONGEST_STEP_S = 10.0
# After a longer silence the temperature is taken from the next reading alone.
LONGEST_GAP_S = 60.0
# A reading this many deviations off is not believed, until a second one says the same.
IMPLAUSIBLE_DEVIATIONS = 6.0
LEAST_DEVIATION_K = 0.3
LEAST_SOC_DEVIATION = 0.01
# Standard deviation of a single reading's noise, where nothing else is known of it.
READING_NOISE_K = 0.3
READING_NOISE_SOC = 0.005
# What cabin and auxiliaries take at most [W]; a battery power beyond that of a drivetrain at its
# limit, the heater and these is none.
MOST_OTHER_POWER_W = 20e3
# A belief less sure than this has been upset [K].
MOST_DEVIATION_K = 50.0
# One switching of the heater tells no more than this (nats), or a single odd step would decide.
EVIDENCE_OF_A_SWITCHING = 5.0
# Element of `state`, reading, step of the signal, least standard deviation.
Look = tuple[int, float, float, float]


class Measurement(Protocol):
    """What is measured at an instant [ns]; `power_w` is None where it is not."""

    @property
    def stamp_ns(self) -> int:
        """Instant of the measurement [ns]."""

    @property
    def state(self) -> BatteryState:
        """Temperature and state of charge."""

    @property
    def power_w(self) -> float | None:
        """Terminal power of the battery [W]."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """
    What is believed of the battery at an instant [ns].

    `mean` (7,) and `covariance` (7, 7) are those of the elements of `state`.

    `heater` says how the heater answers, `temperature_resolution_k` in which steps the temperature
    is reported (0: continuous), `resets` how often the estimator was reset, why and when last.
    """

    stamp_ns: int
    mean: FloatArray
    covariance: FloatArray
    heater: HeaterReport
    temperature_resolution_k: float
    resets: int = 0
    reset_reason: str = ''
    reset_at_ns: int | None = None

    @property
    def log_factors(self) -> FloatArray:
        """Logarithms of the factors (5,), in the order of `state`."""
        return self.mean[FACTORS]

    @property
    def temperature_c(self) -> float:
        """Battery temperature [deg C]."""
        return float(self.mean[TEMPERATURE])

    @property
    def temperature_deviation_k(self) -> float:
        """Standard deviation of the battery temperature [K]."""
        return math.sqrt(max(self.covariance[TEMPERATURE, TEMPERATURE], 0.0))

    @property
    def soc(self) -> float:
        """State of charge, 0 ... 1."""
        return min(max(float(self.mean[SOC]), 0.0), 1.0)

    @property
    def corrections(self) -> Corrections:
        """Corrections of the vehicle file."""
        return Corrections(*(math.exp(value) for value in self.mean[FACTORS][:4]))

    @property
    def propulsion_factor(self) -> float:
        """Propulsion power of the car as a multiple of the route's."""
        return math.exp(self.mean[PROPULSION])

    @property
    def factor_deviations(self) -> FloatArray:
        """Standard deviations of the five factors, as shares of them, in the order of `state`."""
        return np.sqrt(np.maximum(np.diag(self.covariance)[FACTORS], 0.0))


@dataclass(frozen=True)
class Stretch:
    """
    What was planned and commanded for `duration_s` [s].

    `drive` is the planned DriveInputs, None where no route covers it; `command_w` is the mean
    command to the heater [W], `limit_w` the heater power that the cabin leaves [W].
    """

    duration_s: float
    drive: DriveInputs | None
    command_w: float
    limit_w: float


class Estimator:
    """Keeps the belief; `observe` takes a measurement in and updates `estimate`."""

    def __init__(self, vehicle: Vehicle, factors: FloatArray | None = None,
                 factor_covariance: FloatArray | None = None) -> None:
        """Begin with the vehicle file, or with what was learned before: see Belief."""
        self._vehicle = vehicle
        self._most_power_w = (vehicle.drivetrain.maximum_power_w + vehicle.hvch.maximum_power_w
                              + MOST_OTHER_POWER_W)
        self._learned = (factors, factor_covariance)
        self.estimate: Estimate | None = None
        self._resets, self._reason = 0, ''
        self._reset_at_ns: int | None = None
        self._begin()

    def _begin(self) -> None:
        self._belief = Belief(self._vehicle, *self._learned)
        self._response = PowerResponse()
        self._temperature_steps = Resolution(TEMPERATURE_STEPS_K)
        self._soc_steps = Resolution(SOC_STEPS)
        self._stamp_ns: int | None = None
        self._powers_w: list[float] = []
        # A reading that was not believed, waiting for a second one.
        self._doubted: Measurement | None = None

    def lose_time(self) -> None:
        """Take the temperature from the next reading alone: stamps so far mean nothing."""
        self._stamp_ns, self._powers_w = None, []
        self._response = PowerResponse()

    def restart(self, reason: str, at_ns: int) -> None:
        """Forget the temperature, and all that was learned since the vehicle file."""
        self._learned = (None, None)
        self._resets += 1
        self._reason, self._reset_at_ns = reason, at_ns
        self._begin()

    def edges_ns(self, stamp_ns: int) -> tuple[int, ...]:
        """
        Return the instants [ns] between which `observe` needs a Stretch each, for a measurement.

        () where it needs none: for the first one, after a long gap, and where it comes too soon.
        """
        if self._stamp_ns is None:
            return ()
        elapsed_s = (stamp_ns - self._stamp_ns) / NS_PER_S
        if elapsed_s > LONGEST_GAP_S or elapsed_s < LEAST_INTERVAL_S:
            return ()
        from_ns = self._stamp_ns
        steps = math.ceil((stamp_ns - from_ns) / NS_PER_S / LONGEST_STEP_S)
        return tuple(from_ns + (stamp_ns - from_ns) * part // steps for part in range(steps + 1))

    def observe(self, measurement: Measurement, command_w: float,
                stretches: Iterable[Stretch]) -> None:
        """
        Take a Measurement in, whose stamp is not before that of the one before.

        `command_w` is the command to the heater at its instant [W]; `stretches` are one Stretch
        between each of `edges_ns(measurement.stamp_ns)` and the next.
        """
        state = measurement.state
        self._temperature_steps.see(state.temperature_c)
        self._soc_steps.see(state.soc)
        stamp_ns = measurement.stamp_ns
        if self._stamp_ns is None:
            self._place(measurement)
            return
        elapsed_s = (stamp_ns - self._stamp_ns) / NS_PER_S
        if elapsed_s > LONGEST_GAP_S:
            self._place(measurement)
            return
        if not self._is_plausible(state, self._belief.expected()):
            if self._doubted is None or stamp_ns == self._doubted.stamp_ns:
                self._doubted = measurement
            elif self._agree(self._doubted.state, state):
                assert self.estimate is not None
                self.restart(f'battery_state jumped to {state.temperature_c:.1f} degC, '
                             f'{100 * state.soc:.1f} %: {self.estimate.temperature_c:.1f} degC, '
                             f'{100 * self.estimate.soc:.1f} % were expected', stamp_ns)
                self.observe(measurement, command_w, ())
                return
            else:
                self._doubted = measurement
        else:
            self._doubted = None
        self._see_power(measurement, command_w)
        if elapsed_s < LEAST_INTERVAL_S:
            return
        self._advance(stretches)
        if self._doubted is None:
            self._belief.see_temperature(state.temperature_c, self._temperature_steps.step)
            self._belief.see_soc(state.soc, self._soc_steps.step)
        self._conclude(measurement)

    def _place(self, measurement: Measurement) -> None:
        state = measurement.state
        self._belief.place(
            state.temperature_c, self._temperature_steps.step**2 / 12.0 + READING_NOISE_K**2,
            state.soc, self._soc_steps.step**2 / 12.0 + READING_NOISE_SOC**2)
        power_w = self._plausible_power_w(measurement)
        self._powers_w = [] if power_w is None else [power_w]
        self._conclude(measurement)

    def _plausible_power_w(self, measurement: Measurement) -> float | None:
        """Return the battery's power [W]; None where it is not known, or no car's."""
        power_w = measurement.power_w
        return None if power_w is None or abs(power_w) > self._most_power_w else power_w

    def _see_power(self, measurement: Measurement, command_w: float) -> None:
        power_w = self._plausible_power_w(measurement)
        if power_w is None:
            self._powers_w = []
            return
        self._powers_w.append(power_w)
        answer = self._response.see(measurement.stamp_ns / NS_PER_S, power_w, command_w)
        if answer is not None:
            self._belief.see_share(answer.share, answer.deviation, EVIDENCE_OF_A_SWITCHING)

    def _advance(self, stretches: Iterable[Stretch]) -> None:
        """Move the belief on through Stretches."""
        seen_w = None
        variance_w2 = 0.0
        # The first sample is that of the step before, which ended where this one begins.
        if len(self._powers_w) >= 2:
            seen_w, variance_w2 = float(np.mean(self._powers_w)), float(np.var(self._powers_w))
        for stretch in stretches:
            drive, duration_s = stretch.drive, stretch.duration_s
            if drive is not None and seen_w is not None:
                drive = replace(drive, terminal_power_w=seen_w, power_variance_w2=variance_w2)
            self._belief.predict(duration_s, drive, stretch.command_w, stretch.limit_w)
            if drive is not None and seen_w is not None:
                heater_w = stretch.command_w if self.estimate is None else (
                    min(self.estimate.heater.share * stretch.command_w, stretch.limit_w))
                self._belief.see_propulsion_power(
                    seen_w - heater_w - drive.cabin_heating_power_w - drive.auxiliary_power_w,
                    drive.propulsion_power_w, duration_s)
        self._powers_w = self._powers_w[-1:]

    def _is_plausible(self, state: BatteryState, belief: tuple[FloatArray, FloatArray]) -> bool:
        """Whether readings are what is believed, (mean (SIZE,), covariance), or may be."""
        mean, covariance = belief
        return all(
            abs(reading - mean[index]) <= 0.5 * step + IMPLAUSIBLE_DEVIATIONS * max(
                math.sqrt(max(covariance[index, index], 0.0)), least)
            for index, reading, step, least in self._looks_at(state))

    def _agree(self, one: BatteryState, other: BatteryState) -> bool:
        """Whether two readings that were not believed say the same."""
        return all(
            abs(reading - before) <= step + IMPLAUSIBLE_DEVIATIONS * least
            for (_, before, _, _), (_, reading, step, least) in zip(
                self._looks_at(one), self._looks_at(other)))

    def _looks_at(self, state: BatteryState) -> tuple[Look, Look]:
        """(element, reading, step of the signal, least standard deviation) of both readings."""
        return ((TEMPERATURE, state.temperature_c, self._temperature_steps.step,
                 LEAST_DEVIATION_K),
                (SOC, state.soc, self._soc_steps.step, LEAST_SOC_DEVIATION))

    def _conclude(self, measurement: Measurement) -> None:
        stamp_ns = self._stamp_ns = measurement.stamp_ns
        mean, covariance = self._belief.expected()
        if not _is_sound(mean, covariance):
            self.restart('the estimate left the range in which it means anything', stamp_ns)
            self._place(measurement)
            return
        report = judge(self._belief.weights.sum(axis=1),
                       self.estimate.heater if self.estimate else None)
        self.estimate = Estimate(
            stamp_ns, mean, covariance, report, self._temperature_steps.step, self._resets,
            self._reason, self._reset_at_ns)


def _is_sound(mean: FloatArray, covariance: FloatArray) -> bool:
    """Whether mean and covariance are numbers that a belief can have."""
    variances = np.diag(covariance)
    return bool(np.isfinite(mean).all() and np.isfinite(covariance).all()
                and (variances >= 0.0).all() and variances[TEMPERATURE] <= MOST_DEVIATION_K**2)
