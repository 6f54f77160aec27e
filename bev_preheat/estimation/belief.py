# SPDX-License-Identifier: Apache-2.0
"""
Belief about the battery: one extended Kalman filter per hypothesis, and the hypotheses' weights.

An interacting multiple-model filter (Blom and Bar-Shalom, IEEE Trans. Automatic Control 33(8),
1988). A heater may change from one kind to another, so the heaters' filters are mixed by the transition
probabilities; the sensor-noise filters run in parallel without mixing. Quantised readings are treated as
intervals (`truncated_normal`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.estimation.hypotheses import (
    heater_power_w,
    KEPT_TRANSITIONS,
    NOISES_K,
    prior_weights,
    SHARES,
    transitions,
)
from bev_preheat.estimation.prior import (
    described_lags,
    FACTOR_BOUNDS,
    FACTOR_DEVIATIONS,
    LAG_BOUNDS,
    LAGS,
    Learned,
    nothing_learned,
    RISE_BOUNDS,
    RISE_DEVIATIONS,
    RISES,
    RISES_K_PER_KW,
)
from bev_preheat.estimation.state import (
    FACTORS,
    HEAT_LAG,
    HEATER_RISE,
    JOULE_RISE,
    LOCAL,
    LOCAL_LAG_S,
    moved_with_slopes,
    MOVING,
    NOMINAL_HEAT_LAG_S,
    NOMINAL_SENSOR_LAG_S,
    PERTURBATION,
    PROPULSION,
    SENSOR,
    SENSOR_LAG,
    SIZE,
    SOC,
    TEMPERATURE,
    UNDER_WAY,
)
from bev_preheat.estimation.truncated_normal import truncated_moments
from bev_preheat.native.belief_structs import belief_terms
from bev_preheat.native.beliefs import Elapsing, NativeBelief, ReadingNoise
from bev_preheat.numerics.arithmetic import array_exp
from bev_preheat.planning.dynamics import native_vehicle
from bev_preheat.planning.heat_run import with_coolant_in_battery

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.numerics.arrays import BoolArray, FloatArray
    from bev_preheat.vehicle.description import Vehicle
    from bev_preheat.vehicle.uncertain_car import DriveInputs

BOUNDED = slice(FACTORS.start, HEATER_RISE + 1)
LOWEST, HIGHEST = np.concatenate((
    [(-FACTOR_BOUNDS[index], FACTOR_BOUNDS[index]) for index in range(FACTORS.start, FACTORS.stop)],
    LAG_BOUNDS, RISE_BOUNDS)).T
# Standard deviation of the sensor's local rise that no heat explains [K]: sensor position, hysteresis, a second
# mass. It has the same time constant as the rise.
LOCAL_DEVIATION_K = 0.15
# The rise by Joule heat varies from one power peak to the next: standard deviation [K/kW]. Both values were
# chosen on the nine measured drives of an i3, where 0.1 ... 0.2 K and 0.8 ... 1.2 K/kW predict equally well.
JOULE_RISE_NOISE_K_PER_KW = 1.0
# Random walk of the true state: standard deviation after an hour. Unmodelled heat moves the temperature
# (0.25 ... 0.5 K predict equally well on the nine drives), a wrong capacity the state of charge.
WANDER_IN_AN_HOUR = np.array(
    [0.25, 0.004, 0.01, 0.02, 0.02, 0.01, 0.1, 0.05, 0.05, 0.02, 0.02, 0.1, 0.1,
     LOCAL_DEVIATION_K * math.sqrt(2.0 * 3600.0 / LOCAL_LAG_S)])
WANDERED_IN_AN_HOUR = np.square(WANDER_IN_AN_HOUR)
# Without a route the drive is unknown.
WANDER_UNKNOWN = np.array([10.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 1.0, 0.1, 0.0])
# The same while the car charges or stands: its factors, lags and rises are not learned.
HELD_WANDER = np.array([10.0, 0.3, *[0.0] * 10, 10.0, 0.0])
# Standard deviations after a gap in the readings [K]: heat under way, battery minus sensor, local rise.
UNKNOWN_UNDER_WAY_K = 0.5
UNKNOWN_APART_K = 0.5
UNKNOWN_LOCAL_K = 0.7
# Largest difference between battery and sensor [K], and most heat held by the coolant [K]. The filter of an
# implausible heater may exceed both.
MOST_APART_K = 8.0
MOST_UNDER_WAY_K = 8.0
SOC_NOISE = 0.001
# Relative error of the route's power (and the least power it applies to), and its correlation time.
POWER_NOISE = 0.3
LEAST_POWER_W = 3000.0
POWER_NOISE_LASTS_S = 60.0
# Readings further off than this many standard deviations are clipped here.
MOST_DEVIATIONS = 2.5
# Limits the evidence of one reading against a hypothesis [nats], so that a single outlier does not decide.
MOST_EVIDENCE = 1.0
# Rounding may make a variance slightly negative.
LEAST_VARIANCE = 1e-12
# Least probability of a hypothesis, so that it can recover.
LEAST_WEIGHT = 1e-12
SHAPE = (len(SHARES), len(NOISES_K))
NOISE_VARIANCES = np.square(NOISES_K)
SOC_NOISE_VARIANCES = np.full(len(NOISES_K), SOC_NOISE**2)
# The constants that the native core needs.
TERMS = belief_terms(
    PERTURBATION, LOWEST, HIGHEST, NOMINAL_HEAT_LAG_S, NOMINAL_SENSOR_LAG_S, LOCAL_LAG_S, LEAST_VARIANCE,
    LEAST_WEIGHT, MOST_EVIDENCE, MOST_APART_K, MOST_UNDER_WAY_K, POWER_NOISE, LEAST_POWER_W, POWER_NOISE_LASTS_S,
    JOULE_RISE_NOISE_K_PER_KW)
READING = ReadingNoise(NOISE_VARIANCES, SOC_NOISE_VARIANCES)


@lru_cache(maxsize=KEPT_TRANSITIONS)
def _elapsing(duration_s: float) -> Elapsing:
    """Return the effect of elapsed time [s] on any filters; read-only."""
    return Elapsing(duration_s, transitions(duration_s), WANDERED_IN_AN_HOUR * (duration_s / 3600.0))


def _rise_noise_k2(duration_s: float) -> float:
    """Return the variance added to the local rise by JOULE_RISE_NOISE_K_PER_KW, divided by its slope squared."""
    left = math.exp(-duration_s / LOCAL_LAG_S)
    return JOULE_RISE_NOISE_K_PER_KW**2 * (1.0 + left) / (1.0 - left)


def _hidden_s2(drive: DriveInputs, duration_s: float) -> float:
    """Return the variance of the logarithm of the propulsion power in `duration_s` [s] times s^2."""
    # Without measured power, traffic's effect on the route's power is unseen; it moves temperature and charge.
    return (0.0 if drive.terminal_power_w is not None
            else POWER_NOISE_LASTS_S * duration_s * POWER_NOISE**2)


def _propulsion_noise(route_w: float, duration_s: float) -> tuple[float, float]:
    """Return the variance [W^2] of a route's power over `duration_s` [s], and the clipping limit [W]."""
    deviation_w = POWER_NOISE * max(abs(route_w), LEAST_POWER_W)
    return (deviation_w**2 * max(1.0, POWER_NOISE_LASTS_S / duration_s),
            MOST_DEVIATIONS * deviation_w)


def _interval(reading: float, resolution: float) -> tuple[float, float]:
    """Return the interval that contains the value behind a rounded reading."""
    return reading - 0.5 * resolution, reading + 0.5 * resolution


class Belief:
    """
    Means (heaters, noises, SIZE), covariances (…, SIZE, SIZE) and weights (heaters, noises).

    `predict` advances time; the `see_…` methods update with readings.
    """

    def __init__(self, vehicle: Vehicle, learned: Learned | None = None) -> None:
        """Start from a Learned of the car; None: from its vehicle file alone."""
        # Coolant that warms with the battery counts as battery; its delay is a lag.
        self._vehicle = (with_coolant_in_battery(vehicle) if vehicle.heat_path.has_coolant
                         else vehicle)
        self._native_vehicle = native_vehicle(self._vehicle)
        self._native: NativeBelief | None = None
        learned = nothing_learned(vehicle.uncertainty) if learned is None else learned
        self.weights = prior_weights()
        self.mean = np.zeros((*SHAPE, SIZE))
        self.covariance = np.zeros((*SHAPE, SIZE, SIZE))
        self.mean[..., FACTORS] = learned.factors
        self.covariance[..., FACTORS, FACTORS] = learned.covariance
        self._lags = described_lags(vehicle.heat_path) if learned.lags is None else learned.lags
        self.mean[..., LAGS] = self._lags.logs
        self.covariance[..., LAGS, LAGS] = self._lags.variances
        self.mean[..., RISES] = RISES_K_PER_KW
        self.covariance[..., RISES, RISES] = np.square(RISE_DEVIATIONS)
        self._has_stood = True

    def place(self, temperature_c: float, temperature_variance: float, soc: float,
              soc_variance: float) -> None:
        """
        Reset temperature and state of charge; the learned factors stay.

        The first time there is no heat under way and the sensor shows the battery temperature. Later both are
        uncertain, and the heater's hypotheses are half as sure, because the heater may have changed.
        """
        if not self._has_stood:
            self.weights = 0.5 * (self.weights + prior_weights())
        self.mean[..., TEMPERATURE], self.mean[..., SOC] = temperature_c, soc
        self.mean[..., SENSOR], self.mean[..., UNDER_WAY] = temperature_c, 0.0
        self.mean[..., LOCAL] = 0.0
        under_way_k, apart_k, local_k = (0.0, 0.0, 0.0) if self._has_stood else (
            UNKNOWN_UNDER_WAY_K, UNKNOWN_APART_K, UNKNOWN_LOCAL_K)
        self._has_stood = False
        # A reading is the sum of sensor and local rise, so their errors have opposite signs.
        sensor_variance = temperature_variance + local_k**2
        for index, variance in ((TEMPERATURE, sensor_variance + apart_k**2),
                                (SOC, soc_variance), (UNDER_WAY, under_way_k**2),
                                (SENSOR, sensor_variance), (LOCAL, local_k**2)):
            self.covariance[..., index, :] = 0.0
            self.covariance[..., :, index] = 0.0
            self.covariance[..., index, index] = variance
        for one, other, shared in ((TEMPERATURE, SENSOR, sensor_variance),
                                   (TEMPERATURE, LOCAL, -local_k**2), (SENSOR, LOCAL, -local_k**2)):
            self.covariance[..., one, other] = self.covariance[..., other, one] = shared

    def acquit_heater(self) -> None:
        """Take the heater for healthy: prior weights, and the likeliest filter for every hypothesis."""
        likeliest = int(self.weights.sum(axis=1).argmax())
        self.mean = np.repeat(self.mean[likeliest:likeliest + 1], len(SHARES), axis=0)
        self.covariance = np.repeat(self.covariance[likeliest:likeliest + 1], len(SHARES), axis=0)
        self.weights = prior_weights()

    def begin_route(self) -> None:
        """Reset the factor on the propulsion power, which belongs to the previous route."""
        self.mean[..., PROPULSION] = 0.0
        self.covariance[..., PROPULSION, :] = self.covariance[..., :, PROPULSION] = 0.0
        self.covariance[..., PROPULSION, PROPULSION] = FACTOR_DEVIATIONS[PROPULSION]**2

    def stand(self) -> None:
        """Note that the car has stood: no heat is under way, and the sensor shows the battery temperature."""
        self._has_stood = True

    def predict(self, duration_s: float, drive: DriveInputs | None, command_w: float,
                limit_w: float) -> None:
        """
        Advance by `duration_s` in a DriveInputs under a heater command.

        `drive` is a DriveInputs of floats (heater power is not read); None: the drive is unknown.
        """
        self.mix(duration_s)
        if drive is None:
            self._pass_unknown(duration_s)
        else:
            self._move(duration_s, drive, command_w, limit_w)

    def follow(self, duration_s: float, drive: DriveInputs, command_w: float, limit_w: float,
               propulsion_w: float) -> None:
        """
        Do `predict` with a drive and, if its terminal power was measured, `see_propulsion_power`.

        `propulsion_w` [W] is the terminal power minus all other consumers.
        """
        done, lost = 0, 0
        if self._native_vehicle is not None:
            done, lost = self._core_belief().follow(
                self._native_vehicle, TERMS, _elapsing(duration_s), drive, self._vehicle.battery.leakage,
                heater_power_w(command_w, limit_w), _hidden_s2(drive, duration_s),
                (propulsion_w, drive.propulsion_power_w,
                 *_propulsion_noise(drive.propulsion_power_w, duration_s)))
        # The steps that the core did not do follow here.
        if done < 1:
            self.mix(duration_s)
        if done < 2:
            self._move(duration_s, drive, command_w, limit_w)
        if done == 3:
            self._keep_bounds(lost)
        elif drive.terminal_power_w is not None:
            self.see_propulsion_power(propulsion_w, drive.propulsion_power_w, duration_s)

    def hold(self, duration_s: float, interval_c: tuple[float, float] | None,
             interval: tuple[float, float] | None) -> None:
        """
        Advance by `duration_s` [s] that the model does not describe, without learning about the car.

        Factors, lags and the weights of the hypotheses stay. Temperature and state of charge follow
        the intervals of their readings [deg C], (0 ... 1); None: no valid reading. Heat under way arrives and
        the sensor approaches the battery's temperature, with their lags.
        """
        self._forget_correlations()
        sensor_left, heat_left = (
            np.exp(-duration_s / (nominal_s * array_exp(self.mean[..., index])))
            for index, nominal_s in ((SENSOR_LAG, NOMINAL_SENSOR_LAG_S), (HEAT_LAG, NOMINAL_HEAT_LAG_S)))
        local_left = math.exp(-duration_s / LOCAL_LAG_S)
        step = np.zeros((*SHAPE, SIZE, SIZE))
        step[..., range(SIZE), range(SIZE)] = 1.0
        step[..., TEMPERATURE, TEMPERATURE] = sensor_left
        step[..., TEMPERATURE, SENSOR] = 1.0 - sensor_left
        step[..., UNDER_WAY, UNDER_WAY] = heat_left
        step[..., LOCAL, LOCAL] = local_left
        self.mean = (step @ self.mean[..., np.newaxis])[..., 0]
        self.covariance = step @ self.covariance @ np.swapaxes(step, -1, -2)
        wandered = HELD_WANDER**2 * (duration_s / 3600.0)
        wandered[LOCAL] = LOCAL_DEVIATION_K**2 * (1.0 - local_left**2)
        self._add_noise(wandered)
        for row, column in ((TEMPERATURE, SENSOR), (SENSOR, TEMPERATURE)):
            self.covariance[..., row, column] += wandered[TEMPERATURE]
        if interval_c is not None:
            self._see_interval(SENSOR, NOISE_VARIANCES, *interval_c, tells_hypotheses=False)
        if interval is not None:
            self._see_interval(SOC, SOC_NOISE_VARIANCES, *interval, tells_hypotheses=False)

    def _forget_correlations(self) -> None:
        """Decorrelate the moving elements from factors and lags, so that readings do not change the latter."""
        for index in MOVING:
            kept = self.covariance[..., index, MOVING].copy()
            self.covariance[..., index, :] = self.covariance[..., :, index] = 0.0
            self.covariance[..., index, MOVING] = kept
            self.covariance[..., MOVING, index] = kept

    def free_local_rise(self) -> None:
        """Make the local rise at the sensor unknown, because the readings have shifted for good."""
        self.covariance[..., LOCAL, LOCAL] += UNKNOWN_LOCAL_K**2

    def _pass_unknown(self, duration_s: float) -> None:
        hours = duration_s / 3600.0
        # The sensor follows the battery.
        self._add_noise(WANDER_UNKNOWN**2 * hours)
        wandered = WANDER_UNKNOWN[TEMPERATURE]**2 * hours
        for row, column in ((SENSOR, SENSOR), (TEMPERATURE, SENSOR), (SENSOR, TEMPERATURE)):
            self.covariance[..., row, column] += wandered

    def _move(self, duration_s: float, drive: DriveInputs, command_w: float, limit_w: float) -> None:
        heater_w, wander = np.array(heater_power_w(command_w, limit_w)), _elapsing(duration_s).wander
        hidden_s2 = _hidden_s2(drive, duration_s)
        if self._native_vehicle is not None and self._core_belief().move(
                self._native_vehicle, TERMS, drive, self._vehicle.battery.leakage, duration_s,
                heater_w, wander, hidden_s2):
            return
        after, slopes = moved_with_slopes(
            self._vehicle, self.mean, replace(
                drive, heater_power_w=heater_w[:, np.newaxis, np.newaxis]), duration_s)
        step = np.zeros((*SHAPE, SIZE, SIZE))
        step[..., range(SIZE), range(SIZE)] = 1.0
        step[..., MOVING, :] = slopes
        self.mean[..., MOVING] = after
        self.covariance = step @ self.covariance @ np.swapaxes(step, -1, -2)
        self._add_noise(wander)
        # The slope of the local rise over the steady rise is proportional to the Joule heat.
        rose = slopes[..., MOVING.index(LOCAL), JOULE_RISE]
        self.covariance[..., LOCAL, LOCAL] += _rise_noise_k2(duration_s) * (rose * rose)
        moved = slopes[..., :2, PROPULSION] / duration_s
        self.covariance[..., :2, :2] += (
            hidden_s2 * moved[..., :, np.newaxis] * moved[..., np.newaxis, :])

    def see_temperature(self, reading_c: float, resolution_k: float, tells_hypotheses: bool = True) -> None:
        """Update with a temperature reading [deg C], rounded to `resolution_k` [K]."""
        self._see_interval(
            SENSOR, NOISE_VARIANCES, *_interval(reading_c, resolution_k), tells_hypotheses=tells_hypotheses)

    def see_soc(self, reading: float, resolution: float) -> None:
        """Update with a reading of the state of charge (0 ... 1)."""
        self._see_interval(
            SOC, SOC_NOISE_VARIANCES, *_interval(reading, resolution), tells_hypotheses=False)

    def see_propulsion_power(self, seen_w: float, route_w: float, duration_s: float) -> None:
        """Update with the mean propulsion power measured [W] and the route's over `duration_s` [s]."""
        variance, most_w = _propulsion_noise(route_w, duration_s)
        lost = self._core_belief().see_propulsion_power(TERMS, seen_w, route_w, variance, most_w)
        if lost is not None:
            self._keep_bounds(lost)
            return
        factor = array_exp(self.mean[..., PROPULSION])
        slope = factor * route_w
        gain = self.covariance[..., PROPULSION] * slope[..., np.newaxis]
        total = slope**2 * self.covariance[..., PROPULSION, PROPULSION] + variance
        error_w = np.clip(seen_w - factor * route_w, -most_w, most_w)
        self.mean += gain * (error_w / total)[..., np.newaxis]
        self.covariance -= (gain[..., :, np.newaxis] * gain[..., np.newaxis, :]
                            / total[..., np.newaxis, np.newaxis])
        self._keep_bounds()

    def see_battery(self, temperature_c: float, resolution_k: float, soc: float, resolution: float,
                    tells_hypotheses: bool = True) -> tuple[FloatArray, FloatArray]:
        """Do `see_temperature` and `see_soc`; return the `expected` mean and covariance."""
        interval_c, interval = _interval(temperature_c, resolution_k), _interval(soc, resolution)
        done, lost, expected = self._core_belief().take_reading(
            TERMS, READING, interval_c, interval, tells_hypotheses)
        if done < 1:
            self.see_temperature(temperature_c, resolution_k, tells_hypotheses)
        elif done == 1:
            self._keep_bounds(lost)
        if done < 2:
            self.see_soc(soc, resolution)
        elif done == 2:
            self._keep_bounds(lost)
        return self.expected() if done < 3 else expected

    def weigh(self, logs: Sequence[float]) -> None:
        """Weight the heaters by the log-likelihoods (heaters,) of other evidence."""
        self.weights *= array_exp(np.subtract(logs, max(logs)))[:, np.newaxis]
        self.weights = np.maximum(self.weights, LEAST_WEIGHT)
        self.weights /= self.weights.sum()

    def expected(self) -> tuple[FloatArray, FloatArray]:
        """Return mean (SIZE,) and covariance (SIZE, SIZE) over all hypotheses."""
        native = self._core_belief().expected()
        if native is not None:
            return native
        weights = self.weights[..., np.newaxis]
        mean = (weights * self.mean).sum(axis=(0, 1))
        off = self.mean - mean
        covariance = (weights[..., np.newaxis] * (
            self.covariance + off[..., :, np.newaxis] * off[..., np.newaxis, :])).sum(axis=(0, 1))
        return mean, covariance

    def _core_belief(self) -> NativeBelief:
        """Return the filters in the form of the native core."""
        native = self._native
        if native is None or not (native.weights is self.weights and native.mean is self.mean
                                  and native.covariance is self.covariance):
            self.weights, self.mean, self.covariance = map(
                np.ascontiguousarray, (self.weights, self.mean, self.covariance))
            native = self._native = NativeBelief(self.weights, self.mean, self.covariance)
        return native

    def _see_interval(self, index: int, noise_variance: FloatArray, low: float, high: float,
                      tells_hypotheses: bool = True) -> None:
        """Kalman update of one element; `noise_variance` (noises,) is added to its own variance."""
        lost = self._core_belief().see_interval(
            TERMS, index, noise_variance, low, high, tells_hypotheses)
        if lost is not None:
            self._keep_bounds(lost)
            return
        # A temperature reading is the sum of sensor and local rise.
        read = (SENSOR, LOCAL) if index == SENSOR else (index,)
        columns = self.covariance[..., read].sum(axis=-1)
        variance = np.maximum(columns[..., read].sum(axis=-1) + noise_variance, LEAST_VARIANCE)
        means = self.mean[..., read].sum(axis=-1)
        # Convert to floats at once; indexing one by one costs as much time as the moments.
        seen_means, seen_variances, logs = np.array([
            truncated_moments(mean, own, low, high)
            for mean, own in zip(means.ravel().tolist(), variance.ravel().tolist())
        ]).T.reshape(3, *SHAPE)
        shift, kept = seen_means - means, variance - seen_variances
        gain = columns / variance[..., np.newaxis]
        self.mean += gain * shift[..., np.newaxis]
        self.covariance -= (gain[..., :, np.newaxis] * gain[..., np.newaxis, :]
                            * kept[..., np.newaxis, np.newaxis])
        self._keep_bounds()
        if tells_hypotheses:
            self.weights *= array_exp(np.maximum(logs - logs.max(), -MOST_EVIDENCE))
            self.weights = np.maximum(self.weights, LEAST_WEIGHT)
            self.weights /= self.weights.sum()

    def mix(self, duration_s: float) -> None:
        """Mix the heaters' filters, because a heater may have changed from one kind to another."""
        matrix = _elapsing(duration_s).transitions
        if self._core_belief().mix(matrix):
            return
        # share[from, to, noise]: how much of `to` was `from` before.
        share = matrix[:, :, np.newaxis] * self.weights[:, np.newaxis, :]
        total = share.sum(axis=0)
        share /= total
        mean = np.einsum('abn,ani->bni', share, self.mean)
        off = self.mean[:, np.newaxis] - mean[np.newaxis]
        self.covariance = (
            np.einsum('abn,anij->bnij', share, self.covariance)
            + np.einsum('abn,abni,abnj->bnij', share, off, off))
        self.mean, self.weights = mean, total

    def _add_noise(self, variances: FloatArray) -> None:
        self.covariance[..., range(SIZE), range(SIZE)] += variances

    def _keep_bounds(self, lost_filters: int = 1) -> None:
        """Clip the filters to their bounds and reset lost ones; `lost_filters` 0: nothing to do."""
        if lost_filters == 0:
            return
        bounded = self.mean[..., BOUNDED]
        np.minimum(bounded, HIGHEST, out=bounded)
        np.maximum(bounded, LOWEST, out=bounded)
        lost = ((np.abs(self.mean[..., TEMPERATURE] - self.mean[..., SENSOR]) > MOST_APART_K)
                | (np.abs(self.mean[..., UNDER_WAY]) > MOST_UNDER_WAY_K))
        if lost.any():
            self._find_again(lost)

    def _find_again(self, lost: BoolArray) -> None:
        """Reset the lags and rises of lost filters (heaters, noises)."""
        mean, covariance = self.mean[lost], self.covariance[lost]
        mean[:, TEMPERATURE], mean[:, UNDER_WAY] = mean[:, SENSOR], 0.0
        mean[:, LAGS], mean[:, RISES] = self._lags.logs, RISES_K_PER_KW
        for index in (TEMPERATURE, *LAGS, *RISES, UNDER_WAY):
            covariance[:, index, :] = covariance[:, :, index] = 0.0
        covariance[:, LAGS, LAGS] = self._lags.variances
        covariance[:, RISES, RISES] = np.square(RISE_DEVIATIONS)
        covariance[:, UNDER_WAY, UNDER_WAY] = UNKNOWN_UNDER_WAY_K**2
        covariance[:, TEMPERATURE, TEMPERATURE] = (
            covariance[:, SENSOR, SENSOR] + UNKNOWN_APART_K**2)
        self.mean[lost], self.covariance[lost] = mean, covariance
