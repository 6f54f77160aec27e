# SPDX-License-Identifier: Apache-2.0
"""
Estimates the battery state and the corrections of the model from the battery states received.

Instants are integers, in nanoseconds of the clock that stamps the battery states.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
import math
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.estimation.belief import Belief
from bev_preheat.estimation.estimate import Estimate
from bev_preheat.estimation.hypotheses import FAULTY, Heater, HeaterReport, is_suspect, judge, Suspicion
from bev_preheat.estimation.measured_power import PowerResponse, PowerSamples
from bev_preheat.estimation.readings import MeasuredState, ReadingCheck, Verdict
from bev_preheat.estimation.soak import expected_offset_k
from bev_preheat.estimation.state import LOCAL, SENSOR, SOC, TEMPERATURE
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.vehicle.uncertain_car import DriveInputs

if TYPE_CHECKING:
    from bev_preheat.estimation.prior import Learned
    from bev_preheat.estimation.readings import Expected
    from bev_preheat.estimation.soak import Soak
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle.description import Vehicle

# Faster readings are correlated: at most one a second is used.
LEAST_INTERVAL_S = 0.95
# The belief advances in steps of at most this.
LONGEST_STEP_S = 10.0
# After a longer gap the temperature is taken from the next reading alone.
LONGEST_GAP_S = 60.0
# Standard deviation of a single reading's noise while it is unknown.
READING_NOISE_K = 0.3
READING_NOISE_SOC = 0.005
# Most power of cabin and auxiliaries [W]. A battery power above the limits of drivetrain and heater plus
# this is implausible.
MOST_OTHER_POWER_W = 20e3
# A larger standard deviation means that the belief has diverged [K].
MOST_DEVIATION_K = 50.0


class DrivenInterval(NamedTuple):
    """
    The planned drive and the command for `duration_s` [s].

    `drive` is the planned DriveInputs, None if no route covers it; `command_w` is the mean
    command to the heater [W], `limit_w` the heater power left by the cabin [W].
    """

    duration_s: float
    drive: DriveInputs | None
    command_w: float
    limit_w: float


class Estimator:
    """Holds the belief; `observe` updates it and `estimate` with a measurement."""

    def __init__(self, vehicle: Vehicle, learned: Learned | None = None) -> None:
        """Start from the vehicle file, or from earlier Learned values."""
        self._vehicle = vehicle
        self._most_power_w = (vehicle.drivetrain.maximum_power_w + vehicle.hvch.maximum_power_w
                              + MOST_OTHER_POWER_W)
        self._k_per_j = vehicle.hvch.efficiency / vehicle.battery.heat_capacity_j_per_k
        self._learned = learned
        self.estimate: Estimate | None = None
        self._resets, self._reason = 0, ''
        self._reset_at_ns: int | None = None
        self._begin()

    def _begin(self) -> None:
        self._belief = Belief(self._vehicle, self._learned)
        self._response = PowerResponse()
        self._readings = ReadingCheck()
        # Mean and covariance of the belief after the latest measurement; None: not computed yet.
        self._expected: tuple[FloatArray, FloatArray] | None = None
        self._stamp_ns: int | None = None
        # The soak that the next reading belongs to, and the offset subtracted from readings [K].
        self._standing: Soak | None = None
        self._offset_k = 0.0
        self._power = PowerSamples()
        self._knows_power = False
        # Instant [ns] since which the heater has been suspect; None: it is not.
        self._suspect_since_ns: int | None = None
        # Heat commanded, and uncommanded heat that the heater could have given, since then [K].
        self._commanded_k = self._uncommanded_k = self._suspect_from_c = 0.0

    def lose_time(self) -> None:
        """Take the temperature from the next reading alone, because earlier stamps are invalid."""
        self._stamp_ns = self._suspect_since_ns = None
        self._power.forget_latest()
        self._response = PowerResponse()

    def begin_route(self) -> None:
        """Reset the propulsion factor, because a new trip begins."""
        self._belief.begin_route()
        self._expected = None

    def acquit_heater(self) -> None:
        """Take the heater for healthy, because the power with which it was compared is refuted."""
        if self.estimate is None:
            return
        self._belief.acquit_heater()
        self._response = PowerResponse()
        self._suspect_since_ns = None
        self.estimate = replace(self.estimate, heater=HeaterReport(Heater.ANSWERS, 1.0 - FAULTY, 1.0))

    def rely_on(self, standing: Soak) -> None:
        """Take the sensor's offset from the next reading, which is of a battery after a Soak."""
        self._standing = standing
        self._belief.stand()
        self.lose_time()

    def restart(self, reason: str, at_ns: int) -> None:
        """Reset the temperature and everything learned since the vehicle file."""
        self._learned = None
        self._resets += 1
        self._reason, self._reset_at_ns = reason, at_ns
        self._begin()

    def edges_ns(self, stamp_ns: int) -> tuple[int, ...]:
        """
        Return the instants [ns] that divide the time to a measurement into one DrivenInterval each.

        () for the first measurement, after a long gap, and if the measurement comes too soon.
        """
        if self._stamp_ns is None:
            return ()
        elapsed_s = (stamp_ns - self._stamp_ns) / NS_PER_S
        if elapsed_s > LONGEST_GAP_S or elapsed_s < LEAST_INTERVAL_S:
            return ()
        from_ns = self._stamp_ns
        steps = math.ceil((stamp_ns - from_ns) / NS_PER_S / LONGEST_STEP_S)
        return tuple([from_ns + (stamp_ns - from_ns) * part // steps for part in range(steps + 1)])

    def observe(self, measurement: MeasuredState, command_w: float,
                intervals: Iterable[DrivenInterval]) -> None:
        """
        Update with a MeasuredState, whose stamp is not older than the previous one.

        `command_w` is the command to the heater at its instant [W]; `intervals` are one DrivenInterval
        between consecutive `edges_ns(measurement.stamp_ns)`.
        """
        state = measurement.state
        self._readings.see(state)
        stamp_ns = measurement.stamp_ns
        if self._stamp_ns is None:
            self._place(measurement)
            return
        elapsed_s = (stamp_ns - self._stamp_ns) / NS_PER_S
        if elapsed_s > LONGEST_GAP_S:
            self._place(measurement)
            return
        verdict = self._readings.judge(measurement, self._expected_readings())
        if verdict is Verdict.JUMPED:
            self._jump(measurement, command_w)
            return
        self._power.see(stamp_ns / NS_PER_S, self._plausible_power_w(measurement))
        if elapsed_s < LEAST_INTERVAL_S:
            return
        self._advance(intervals)
        if verdict is Verdict.LASTING:
            self._belief.free_local_rise()
        if verdict in (Verdict.BELIEVED, Verdict.LASTING):
            self._conclude(measurement, *self._belief.see_battery(
                state.temperature_c - self._offset_k, self._readings.temperature_resolution_k,
                state.soc, self._readings.soc_resolution,
                # Where power is known, it shows the heater's response.
                tells_hypotheses=True))
        else:
            self._conclude(measurement, *self._belief.expected())

    def hold(self, measurement: MeasuredState, trusts_temperature: bool = True,
             trusts_soc: bool = True) -> None:
        """
        Follow a MeasuredState that the model does not describe, without learning from it.

        The vehicle is charging, stands where its route drives, is on no leg, or a signal is in doubt.
        Hypotheses, factors, lags and the report on the heater stay. A reading that is not trusted is
        ignored.
        """
        state, stamp_ns = measurement.state, measurement.stamp_ns
        if trusts_temperature:
            self._readings.see(state)
        # The next step that the model describes begins here, with its own power samples.
        self._suspect_since_ns = None
        self._power.forget_latest()
        if self._stamp_ns is None or (stamp_ns - self._stamp_ns) / NS_PER_S > LONGEST_GAP_S:
            if trusts_temperature and trusts_soc:
                self._place(measurement)
            return
        elapsed_s = (stamp_ns - self._stamp_ns) / NS_PER_S
        if elapsed_s < LEAST_INTERVAL_S:
            return
        is_believed = True
        if trusts_temperature and trusts_soc:
            verdict = self._readings.judge(measurement, self._expected_readings())
            if verdict is Verdict.JUMPED:
                # The car's factors stay valid: only the battery state was not followed.
                self._stamp_ns = None
                self._place(measurement)
                return
            is_believed = verdict in (Verdict.BELIEVED, Verdict.LASTING)
        temperature_k, soc_step = self._readings.temperature_resolution_k, self._readings.soc_resolution
        reading_c = state.temperature_c - self._offset_k
        self._belief.hold(
            elapsed_s,
            (reading_c - 0.5 * temperature_k, reading_c + 0.5 * temperature_k)
            if is_believed and trusts_temperature else None,
            (state.soc - 0.5 * soc_step, state.soc + 0.5 * soc_step)
            if is_believed and trusts_soc else None)
        self._conclude(measurement, *self._belief.expected(), is_held=True)

    def _expected_readings(self) -> tuple[Expected, Expected]:
        """Return the expected readings of temperature [deg C] and charge, with variances."""
        mean, covariance = self._belief.expected() if self._expected is None else self._expected
        at, between = mean.item, covariance.item
        return ((at(SENSOR) + at(LOCAL) + self._offset_k,
                 between(SENSOR, SENSOR) + 2.0 * between(SENSOR, LOCAL) + between(LOCAL, LOCAL)),
                (at(SOC), between(SOC, SOC)))

    def _jump(self, measurement: MeasuredState, command_w: float) -> None:
        """Restart from a reading that contradicts the expectation."""
        assert self.estimate is not None
        state = measurement.state
        self.restart(f'battery_state jumped to {state.temperature_c:.1f} degC, '
                     f'{100 * state.soc:.1f} %: {self.estimate.temperature_c:.1f} degC, '
                     f'{100 * self.estimate.soc:.1f} % were expected', measurement.stamp_ns)
        self.observe(measurement, command_w, ())

    def _place(self, measurement: MeasuredState) -> None:
        state = measurement.state
        variance = self._readings.temperature_resolution_k**2 / 12.0 + READING_NOISE_K**2
        if self._standing is not None:
            self._offset_k = expected_offset_k(self._standing, state.temperature_c, variance)
            self._standing = None
        self._belief.place(
            state.temperature_c - self._offset_k, variance, state.soc,
            self._readings.soc_resolution**2 / 12.0 + READING_NOISE_SOC**2)
        self._power.begin_step(self._plausible_power_w(measurement))
        self._conclude(measurement, *self._belief.expected())

    def _plausible_power_w(self, measurement: MeasuredState) -> float | None:
        """Return the battery's power [W]; None if it is unknown or implausible."""
        power_w = measurement.power_w
        return None if power_w is None or abs(power_w) > self._most_power_w else power_w

    def _advance(self, intervals: Iterable[DrivenInterval]) -> None:
        """Advance the belief through DrivenIntervals."""
        seen_w, variance_w2 = self._power.step() or (None, 0.0)
        self._knows_power = seen_w is not None
        for interval in intervals:
            drive, duration_s = interval.drive, interval.duration_s
            self._hear_heater(interval, seen_w)
            if drive is not None and seen_w is not None:
                drive = DriveInputs(
                    drive.speed_mps, drive.ambient_temperature_c, drive.propulsion_power_w, variance_w2,
                    drive.propulsion_power_magnitude_w, drive.cabin_heating_power_w,
                    drive.auxiliary_power_w, drive.heater_power_w, terminal_power_w=seen_w,
                    hidden_variance_w2=self._power.hidden_w2(drive.power_variance_w2, duration_s))
            self._commanded_k += self._k_per_j * duration_s * interval.command_w
            self._uncommanded_k += self._k_per_j * duration_s * max(0.0, interval.limit_w - interval.command_w)
            if drive is None or seen_w is None:
                self._belief.predict(duration_s, drive, interval.command_w, interval.limit_w)
                continue
            heater_w = interval.command_w if self.estimate is None else (
                min(self.estimate.heater.share * interval.command_w, interval.limit_w))
            propulsion_w = seen_w - heater_w - drive.cabin_heating_power_w - drive.auxiliary_power_w
            self._belief.follow(
                duration_s, drive, interval.command_w, interval.limit_w,
                self._power.mean_propulsion_w(propulsion_w, drive.propulsion_power_w, duration_s))
        self._power.end_step()

    def _hear_heater(self, interval: DrivenInterval, seen_w: float | None) -> None:
        """Weight the heaters by the power measured in a DrivenInterval [W]; None: unknown."""
        drive = interval.drive
        if drive is None or seen_w is None:
            self._response.pause()
            return
        logs = self._response.see(
            interval.duration_s,
            seen_w - drive.propulsion_power_w - drive.cabin_heating_power_w - drive.auxiliary_power_w,
            interval.command_w, interval.limit_w)
        if logs is not None:
            self._belief.weigh(logs.tolist())

    def _conclude(self, measurement: MeasuredState, mean: FloatArray, covariance: FloatArray,
                  is_held: bool = False) -> None:
        """
        Set the estimate after a MeasuredState, from the belief's mean and covariance.

        `is_held`: learning was off, so the report on the heater stays.
        """
        stamp_ns = self._stamp_ns = measurement.stamp_ns
        self._expected = mean, covariance
        if not _is_sound(mean, covariance):
            self.restart('the estimate left its valid range', stamp_ns)
            self._place(measurement)
            return
        weights = [*map(sum, self._belief.weights.tolist())]
        if is_held and self.estimate is not None:
            self._make_estimate(stamp_ns, mean, covariance, self.estimate.heater)
            return
        if not is_suspect(weights):
            self._suspect_since_ns = None
        elif self._suspect_since_ns is None:
            self._suspect_since_ns, self._commanded_k, self._uncommanded_k = stamp_ns, 0.0, 0.0
            self._suspect_from_c = measurement.state.temperature_c
        since_ns = stamp_ns if self._suspect_since_ns is None else self._suspect_since_ns
        suspicion = Suspicion((stamp_ns - since_ns) / NS_PER_S, self._commanded_k, self._uncommanded_k,
                              measurement.state.temperature_c - self._suspect_from_c)
        report = judge(weights, self.estimate.heater if self.estimate else None,
                       suspicion, self._response.support if self._knows_power else None)
        self._make_estimate(stamp_ns, mean, covariance, report)

    def _make_estimate(self, stamp_ns: int, mean: FloatArray, covariance: FloatArray,
                       report: HeaterReport) -> None:
        self.estimate = Estimate(
            stamp_ns, mean, covariance, report, self._readings.temperature_resolution_k, self._resets,
            self._reason, self._reset_at_ns, self._offset_k, self._readings.ignored_share)


def _is_sound(mean: FloatArray, covariance: FloatArray) -> bool:
    """Whether mean and covariance are finite and the variances plausible."""
    # Plain sums are faster than NumPy's for this few numbers. NaN and infinity propagate into a sum.
    covariances = covariance.ravel().tolist()
    variances = covariances[::len(covariance) + 1]
    return (math.isfinite(sum(mean.tolist())) and math.isfinite(sum(covariances))
            and min(variances) >= 0.0 and variances[TEMPERATURE] <= MOST_DEVIATION_K**2)
