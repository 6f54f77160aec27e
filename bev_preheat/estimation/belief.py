# SPDX-License-Identifier: Apache-2.0
"""
The belief about the battery: one extended Kalman filter for each hypothesis, and their weights.

An interacting multiple-model filter (Blom and Bar-Shalom, IEEE Trans. Automatic Control 33(8),
1988): heaters may turn from one kind into another, so their filters are mixed by how likely that is;
the kinds of sensor noise are held beside each other. Readings in whole steps are taken as what they
are, intervals (`truncated_normal`).
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
# Standard deviation of a sensor's local rise that no heat explains [K]: other places, hysteresis, a second
# mass. It lasts as long as the rise.
LOCAL_DEVIATION_K = 0.15
# The rise by Joule heat differs from one peak of the power to the next: standard deviation [K/kW]. Both were
# chosen on the nine measured drives of an i3, where 0.1 ... 0.2 K and 0.8 ... 1.2 K/kW predict equally well.
JOULE_RISE_NOISE_K_PER_KW = 1.0
# How fast the truth wanders: standard deviation after an hour. Heat outside the model moves the temperature
# (0.25 ... 0.5 K predict equally well on the nine drives), a wrong capacity the state of charge.
WANDER_IN_AN_HOUR = np.array(
    [0.25, 0.004, 0.01, 0.02, 0.02, 0.01, 0.1, 0.05, 0.05, 0.02, 0.02, 0.1, 0.1,
     LOCAL_DEVIATION_K * math.sqrt(2.0 * 3600.0 / LOCAL_LAG_S)])
WANDERED_IN_AN_HOUR = np.square(WANDER_IN_AN_HOUR)
# Without a route the car may do anything.
WANDER_UNKNOWN = np.array([10.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 1.0, 0.1, 0.0])
# The same while a car is charged or stands: nothing is learned of its factors, lags and rises.
HELD_WANDER = np.array([10.0, 0.3, *[0.0] * 10, 10.0, 0.0])
# Standard deviations after a silence [K]: heat under way, difference between battery and sensor, local rise.
UNKNOWN_UNDER_WAY_K = 0.5
UNKNOWN_APART_K = 0.5
UNKNOWN_LOCAL_K = 0.7
# No lag sets battery and sensor further apart [K], and no coolant holds more heat [K]. The filter of
# a heater that is out of the question may believe so.
MOST_APART_K = 8.0
MOST_UNDER_WAY_K = 8.0
SOC_NOISE = 0.001
# A route's power is wrong by this share of it (and of this power at least) for this long.
POWER_NOISE = 0.3
LEAST_POWER_W = 3000.0
POWER_NOISE_LASTS_S = 60.0
# Readings further off than so many deviations are clipped here.
MOST_DEVIATIONS = 2.5
# No reading makes a hypothesis less likely than this [nats], or a single odd one would decide.
MOST_EVIDENCE = 1.0
# Rounding may leave a variance a little below 0.
LEAST_VARIANCE = 1e-12
# No hypothesis is less probable than this, or it would never come back.
LEAST_WEIGHT = 1e-12
SHAPE = (len(SHARES), len(NOISES_K))
NOISE_VARIANCES = np.square(NOISES_K)
SOC_NOISE_VARIANCES = np.full(len(NOISES_K), SOC_NOISE**2)
# What of these the compiled core needs.
TERMS = belief_terms(
    PERTURBATION, LOWEST, HIGHEST, NOMINAL_HEAT_LAG_S, NOMINAL_SENSOR_LAG_S, LOCAL_LAG_S, LEAST_VARIANCE,
    LEAST_WEIGHT, MOST_EVIDENCE, MOST_APART_K, MOST_UNDER_WAY_K, POWER_NOISE, LEAST_POWER_W, POWER_NOISE_LASTS_S,
    JOULE_RISE_NOISE_K_PER_KW)
READING = ReadingNoise(NOISE_VARIANCES, SOC_NOISE_VARIANCES)


@lru_cache(maxsize=KEPT_TRANSITIONS)
def _elapsing(duration_s: float) -> Elapsing:
    """Return what time that passes [s] does to any filters; not to be written to."""
    return Elapsing(duration_s, transitions(duration_s), WANDERED_IN_AN_HOUR * (duration_s / 3600.0))


def _rise_noise_k2(duration_s: float) -> float:
    """Return what JOULE_RISE_NOISE_K_PER_KW adds to the local rise's variance, over its slope squared."""
    left = math.exp(-duration_s / LOCAL_LAG_S)
    return JOULE_RISE_NOISE_K_PER_KW**2 * (1.0 + left) / (1.0 - left)


def _hidden_s2(drive: DriveInputs, duration_s: float) -> float:
    """Return the variance of the logarithm of the propulsion power in `duration_s` [s] times s^2."""
    # What traffic adds to the route's power is not seen; it moves both for a while.
    return (0.0 if drive.terminal_power_w is not None
            else POWER_NOISE_LASTS_S * duration_s * POWER_NOISE**2)


def _propulsion_noise(route_w: float, duration_s: float) -> tuple[float, float]:
    """Return the variance [W^2] of a route's power over so long [s], and where a difference is clipped [W]."""
    deviation_w = POWER_NOISE * max(abs(route_w), LEAST_POWER_W)
    return (deviation_w**2 * max(1.0, POWER_NOISE_LASTS_S / duration_s),
            MOST_DEVIATIONS * deviation_w)


def _interval(reading: float, resolution: float) -> tuple[float, float]:
    """Return the interval in which a value lies that is read in whole steps."""
    return reading - 0.5 * resolution, reading + 0.5 * resolution


class Belief:
    """
    Means (heaters, noises, SIZE), covariances (…, SIZE, SIZE) and weights (heaters, noises).

    `predict` lets time pass, the `see_…` methods take readings into account.
    """

    def __init__(self, vehicle: Vehicle, learned: Learned | None = None) -> None:
        """Begin with what was Learned of the car, None: the vehicle file alone is known."""
        # Coolant that gets warm with the battery counts as battery; how late it does is a lag.
        self._vehicle = (with_coolant_in_battery(vehicle) if vehicle.heat_path.has_coolant
                         else vehicle)
        self._native_vehicle = native_vehicle(self._vehicle)
        self._native: NativeBelief | None = None
        learned = nothing_learned() if learned is None else learned
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
        Set temperature and state of charge anew; what was learned of the factors stays.

        The first time nothing is under way, and the sensor shows the battery; later that is open, and the
        heater's hypotheses are half as sure, because the heater may have changed.
        """
        if not self._has_stood:
            self.weights = 0.5 * (self.weights + prior_weights())
        self.mean[..., TEMPERATURE], self.mean[..., SOC] = temperature_c, soc
        self.mean[..., SENSOR], self.mean[..., UNDER_WAY] = temperature_c, 0.0
        self.mean[..., LOCAL] = 0.0
        under_way_k, apart_k, local_k = (0.0, 0.0, 0.0) if self._has_stood else (
            UNKNOWN_UNDER_WAY_K, UNKNOWN_APART_K, UNKNOWN_LOCAL_K)
        self._has_stood = False
        # The reading is the sum of sensor and local rise, so their errors are opposite.
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

    def begin_route(self) -> None:
        """Forget the factor on the propulsion power: it is that of the route before."""
        self.mean[..., PROPULSION] = 0.0
        self.covariance[..., PROPULSION, :] = self.covariance[..., :, PROPULSION] = 0.0
        self.covariance[..., PROPULSION, PROPULSION] = FACTOR_DEVIATIONS[PROPULSION]**2

    def stand(self) -> None:
        """Note that the car has stood: nothing is under way, and the sensor shows the battery."""
        self._has_stood = True

    def predict(self, duration_s: float, drive: DriveInputs | None, command_w: float,
                limit_w: float) -> None:
        """
        Let `duration_s` pass in a DriveInputs under a heater command.

        `drive` is a DriveInputs of floats (heater power is not read), None where nothing is known of
        what the car does.
        """
        self._mix(duration_s)
        if drive is None:
            self._pass_unknown(duration_s)
        else:
            self._move(duration_s, drive, command_w, limit_w)

    def follow(self, duration_s: float, drive: DriveInputs, command_w: float, limit_w: float,
               propulsion_w: float) -> None:
        """
        Do `predict` with a drive, and where its terminal power was seen, `see_propulsion_power`.

        `propulsion_w` [W] is what the terminal power leaves for the propulsion.
        """
        done, lost = 0, 0
        if self._native_vehicle is not None:
            done, lost = self._core_belief().follow(
                self._native_vehicle, TERMS, _elapsing(duration_s), drive, self._vehicle.battery.leakage,
                heater_power_w(command_w, limit_w), _hidden_s2(drive, duration_s),
                (propulsion_w, drive.propulsion_power_w,
                 *_propulsion_noise(drive.propulsion_power_w, duration_s)))
        # What the core has not done, for whatever reason, is done here.
        if done < 1:
            self._mix(duration_s)
        if done < 2:
            self._move(duration_s, drive, command_w, limit_w)
        if done == 3:
            self._keep_bounds(lost)
        elif drive.terminal_power_w is not None:
            self.see_propulsion_power(propulsion_w, drive.propulsion_power_w, duration_s)

    def hold(self, duration_s: float, interval_c: tuple[float, float] | None,
             interval: tuple[float, float] | None) -> None:
        """
        Let `duration_s` [s] pass in which the model does not describe the battery; learn nothing of the car.

        Factors, lags and the weights of the hypotheses stay. Temperature and state of charge follow
        the intervals of their readings [deg C], (0 ... 1); None: there is no valid reading. Heat
        under way arrives, and the sensor comes to the battery's temperature, with their lags.
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
        """Separate the moving elements from factors and lags, so that their readings do not move those."""
        for index in MOVING:
            kept = self.covariance[..., index, MOVING].copy()
            self.covariance[..., index, :] = self.covariance[..., :, index] = 0.0
            self.covariance[..., index, MOVING] = kept
            self.covariance[..., MOVING, index] = kept

    def free_local_rise(self) -> None:
        """Let the local rise at the sensor be unknown, because its readings have moved for good."""
        self.covariance[..., LOCAL, LOCAL] += UNKNOWN_LOCAL_K**2

    def _pass_unknown(self, duration_s: float) -> None:
        hours = duration_s / 3600.0
        # The sensor goes with the battery.
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
        # The slope of the local rise over the steady rise says how much Joule heat there is.
        rose = slopes[..., MOVING.index(LOCAL), JOULE_RISE]
        self.covariance[..., LOCAL, LOCAL] += _rise_noise_k2(duration_s) * (rose * rose)
        moved = slopes[..., :2, PROPULSION] / duration_s
        self.covariance[..., :2, :2] += (
            hidden_s2 * moved[..., :, np.newaxis] * moved[..., np.newaxis, :])

    def see_temperature(self, reading_c: float, resolution_k: float, tells_hypotheses: bool = True) -> None:
        """Take a reading of the temperature [deg C] into account, rounded to `resolution_k` [K]."""
        self._see_interval(
            SENSOR, NOISE_VARIANCES, *_interval(reading_c, resolution_k), tells_hypotheses=tells_hypotheses)

    def see_soc(self, reading: float, resolution: float) -> None:
        """Take a reading of the state of charge (0 ... 1) into account."""
        self._see_interval(
            SOC, SOC_NOISE_VARIANCES, *_interval(reading, resolution), tells_hypotheses=False)

    def see_propulsion_power(self, seen_w: float, route_w: float, duration_s: float) -> None:
        """Compare the mean propulsion power seen [W] with the route's over `duration_s` [s]."""
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
        """Do `see_temperature` and `see_soc`; return what is `expected` then."""
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
        """Weigh the heaters (heaters,) by the logarithms of how likely each makes other evidence."""
        self.weights *= array_exp(np.subtract(logs, max(logs)))[:, np.newaxis]
        self.weights = np.maximum(self.weights, LEAST_WEIGHT)
        self.weights /= self.weights.sum()

    def expected(self) -> tuple[FloatArray, FloatArray]:
        """Mean (SIZE,) and covariance (SIZE, SIZE) over all hypotheses."""
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
        """Return the filters as the compiled core takes them."""
        native = self._native
        if native is None or not (native.weights is self.weights and native.mean is self.mean
                                    and native.covariance is self.covariance):
            self.weights, self.mean, self.covariance = map(
                np.ascontiguousarray, (self.weights, self.mean, self.covariance))
            native = self._native = NativeBelief(self.weights, self.mean, self.covariance)
        return native

    def _see_interval(self, index: int, noise_variance: FloatArray, low: float, high: float,
                      tells_hypotheses: bool = True) -> None:
        """Kalman update of one element; `noise_variance` (noises,) comes on top of its own."""
        lost = self._core_belief().see_interval(
            TERMS, index, noise_variance, low, high, tells_hypotheses)
        if lost is not None:
            self._keep_bounds(lost)
            return
        # The reading is that of the sensor with its local rise.
        read = (SENSOR, LOCAL) if index == SENSOR else (index,)
        columns = self.covariance[..., read].sum(axis=-1)
        variance = np.maximum(columns[..., read].sum(axis=-1) + noise_variance, LEAST_VARIANCE)
        means = self.mean[..., read].sum(axis=-1)
        # Floats out of the arrays at once: one by one that would cost as much as the moments.
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

    def _mix(self, duration_s: float) -> None:
        """Mix the filters of the heaters, as one may have turned into another by now."""
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
        """Hold the filters within bounds; there is nothing to do where none is lost."""
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
        """Begin the filters (heaters, noises) of the lags anew that no longer mean anything."""
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
