# SPDX-License-Identifier: Apache-2.0
"""
Belief about the battery: one extended Kalman filter per hypothesis, and the hypotheses' weights.

An interacting multiple-model filter (Blom and Bar-Shalom, IEEE Trans. Automatic Control 33(8),
1988). A heater may change from one kind to another, so the heaters' filters are mixed by the transition
probabilities; those of the sensor's places run in parallel without mixing. All expect the same noise of the drive.
Quantised readings are treated as intervals (`truncated_moments`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
import math
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bev_preheat.estimation.estimate import (
    FACTORS,
    HEAT_CAPACITY,
    HEAT_LAG,
    HEATER,
    JOULE_RISE,
    LOCAL,
    moved_with_slopes,
    MOVING,
    nominal_heat_lag_s,
    outside_lag_s,
    PERTURBATION,
    PROPULSION,
    SENSOR,
    SENSOR_LAG,
    SENSOR_PLACE,
    shell_excess_k,
    SIZE,
    SOC,
    SOURCE_HEAT,
    state_rates,
    TEMPERATURE,
    UNDER_WAY,
)
from bev_preheat.estimation.hypotheses import (
    HEALTHY,
    heater_power_w,
    KEPT_TRANSITIONS,
    PLACES,
    prior_weights,
    SHARES,
    STUCK,
    transitions,
)
from bev_preheat.estimation.prior import (
    described_lags,
    described_placing,
    FACTOR_BOUNDS,
    FACTOR_DEVIATIONS,
    LAG_BOUNDS,
    LAGS,
    Lags,
    lags_of_places,
    Learned,
    nothing_learned,
    PLACING,
    PLACING_BOUNDS,
)
from bev_preheat.numerics import array_exp, FloatArray, frozen, truncated_moments
from bev_preheat.tunables import (
    CLIPPED_DEVIATIONS,
    EXCESS_DEVIATION,
    JOULE_RISE_NOISE_K_PER_KW,
    LEAST_VARIANCE,
    LEAST_WEIGHT,
    LOCAL_DEVIATION_K,
    LOCAL_LAG_S,
    LOST_PLACE,
    MOST_APART_K,
    MOST_EVIDENCE,
    MOST_NATS,
    NOISY_FROM_W,
    NOMINAL_SENSOR_LAG_S,
    POWER_NOISE,
    POWER_NOISE_LASTS_S,
    SIGNAL_NOISE_K,
    SOC_NOISE,
    UNKNOWN_K,
    UNSEEN_SHELL_RISE,
)
from bev_preheat.vehicle.core_calls import Elapsing, NativeBelief, ReadingNoise, vehicle_in_core
from bev_preheat.vehicle.core_library import operation
from bev_preheat.vehicle.core_structs import belief_terms, BeliefTermsStruct
from bev_preheat.vehicle.description import DIRECT, HeatPath, Vehicle
from bev_preheat.vehicle.variants import DriveInputs, with_coolant_in_battery

BOUNDED = slice(FACTORS.start, SENSOR_PLACE + 1)
LOWEST, HIGHEST = np.concatenate((
    [(-FACTOR_BOUNDS[index], FACTOR_BOUNDS[index]) for index in range(FACTORS.start, FACTORS.stop)],
    LAG_BOUNDS, PLACING_BOUNDS)).T
# Random walk of the true state: standard deviation after an hour. Unmodelled heat moves the temperature
# (0.25 ... 0.5 K predict equally well on the nine drives), a wrong capacity the state of charge. Heat under way
# does not wander: its noise alone told the place of the sensor in drives without heat.
WANDER_IN_AN_HOUR = np.array(
    [0.25, 0.004, 0.01, 0.02, 0.02, 0.01, 0.1, 0.05, 0.05, 0.05, 0.02, 0.02, 0.0, 0.1,
     LOCAL_DEVIATION_K * math.sqrt(2.0 * 3600.0 / LOCAL_LAG_S)])
WANDERED_IN_AN_HOUR = np.square(WANDER_IN_AN_HOUR)
# Without a route the drive is unknown.
WANDER_UNKNOWN = np.array([10.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.1, 0.0])
# The same while the car charges or stands: its factors, lags and rises are not learned.
HELD_WANDER = np.array([10.0, 0.3, *[0.0] * 11, 10.0, 0.0])
SHAPE = (len(SHARES), len(PLACES))
NOISE_VARIANCES = np.full(len(PLACES), SIGNAL_NOISE_K**2)
SOC_NOISE_VARIANCES = np.full(len(PLACES), SOC_NOISE**2)
READING = ReadingNoise(NOISE_VARIANCES, SOC_NOISE_VARIANCES)


@lru_cache(maxsize=KEPT_TRANSITIONS)
def terms_of(path: HeatPath) -> BeliefTermsStruct:
    """Return the constants that the native core needs for a vehicle with a HeatPath."""
    return belief_terms(
        PERTURBATION, LOWEST, HIGHEST, nominal_heat_lag_s(path), NOMINAL_SENSOR_LAG_S, LOCAL_LAG_S,
        path.shell_share, outside_lag_s(path), UNSEEN_SHELL_RISE, LEAST_VARIANCE, LEAST_WEIGHT, MOST_EVIDENCE,
        MOST_APART_K, POWER_NOISE, NOISY_FROM_W, POWER_NOISE_LASTS_S, JOULE_RISE_NOISE_K_PER_KW)


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
    deviation_w = POWER_NOISE * max(abs(route_w), NOISY_FROM_W)
    return (deviation_w**2 * max(1.0, POWER_NOISE_LASTS_S / duration_s),
            CLIPPED_DEVIATIONS * deviation_w)


def interval_of(reading: float, resolution: float) -> tuple[float, float]:
    """Return the interval that contains the value behind a rounded reading."""
    return reading - 0.5 * resolution, reading + 0.5 * resolution


@dataclass(frozen=True, eq=False)
class Belief:
    """
    Weights (heaters, places), means (…, SIZE) and covariances (…, SIZE, SIZE) of the filters; read-only.

    `lags` are those with which a filter begins. `has_stood`: no heat is under way, and the sensor shows the
    battery temperature. `path` is the vehicle's HeatPath.
    """

    weights: FloatArray
    mean: FloatArray
    covariance: FloatArray
    lags: Lags
    has_stood: bool = True
    path: HeatPath = DIRECT

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for array in (self.weights, self.mean, self.covariance):
            frozen(array)

    @classmethod
    def of(cls, vehicle: Vehicle, learned: Learned | None = None) -> Self:
        """Return the Belief from a Learned of the car; None: from its vehicle file alone."""
        learned = nothing_learned(vehicle.uncertainty) if learned is None else learned
        lags = described_lags(vehicle.heat_path) if learned.lags is None else learned.lags
        mean, covariance = np.zeros((*SHAPE, SIZE)), np.zeros((*SHAPE, SIZE, SIZE))
        placing, placing_variances = described_placing(vehicle.heat_path)
        mean[..., FACTORS], mean[..., LAGS], mean[..., PLACING] = learned.factors, lags.logs, placing
        covariance[..., FACTORS, FACTORS] = learned.covariance
        covariance[..., LAGS, LAGS] = lags.variances
        if learned.lags is None and vehicle.heat_path.heat_lag_s <= 0.0:
            mean[..., LAGS], covariance[..., LAGS, LAGS] = lags_of_places()
        covariance[..., PLACING, PLACING] = placing_variances
        if not vehicle.heat_sources:
            _reset(mean, covariance, SOURCE_HEAT, 0.0, 0.0)
        return cls(prior_weights(), mean, covariance, lags, path=vehicle.heat_path)

    # Events

    def placed(self, temperature_c: float, temperature_variance: float, soc: float,
               soc_variance: float, elapsed_s: float = 0.0) -> Belief:
        """
        Return the Belief with another temperature and state of charge; the learned factors stay.

        If it has stood, there is no heat under way and the sensor shows the battery temperature. Else both are
        uncertain, and the heater's hypotheses are half as sure, because the heater may have changed.
        """
        weights = self.weights if self.has_stood else 0.5 * (
            self.weights + prior_weights(self.weights.sum(axis=0)))
        unknown_k = 0.0 if self.has_stood else UNKNOWN_K
        mean, covariance = self.mean.copy(), self.covariance.copy()
        sensor_variance = temperature_variance + unknown_k**2
        for index, value, variance in (
                (TEMPERATURE, temperature_c, sensor_variance + unknown_k**2), (SOC, soc, soc_variance),
                (UNDER_WAY, 0.0, unknown_k**2), (SENSOR, temperature_c, sensor_variance),
                (LOCAL, 0.0, unknown_k**2)):
            _reset(mean, covariance, index, value, variance)
        # A reading is the sum of sensor and local rise, so their errors have opposite signs.
        for one, other, shared in ((TEMPERATURE, SENSOR, sensor_variance),
                                   (TEMPERATURE, LOCAL, -unknown_k**2), (SENSOR, LOCAL, -unknown_k**2)):
            covariance[..., one, other] = covariance[..., other, one] = shared
        if not self.has_stood:
            # The heat under way has decayed since the last state, with a relative error of EXCESS_DEVIATION.
            left_k, place = self._left_k(elapsed_s), mean[..., SENSOR_PLACE]
            left_k2 = (unknown_k / np.maximum(place, 1.0))**2 + (EXCESS_DEVIATION * left_k)**2
            mean[..., UNDER_WAY] = left_k
            mean[..., TEMPERATURE] -= place * left_k
            covariance[..., UNDER_WAY, UNDER_WAY] = left_k2
            covariance[..., TEMPERATURE, TEMPERATURE] += (
                place**2 * left_k2 + left_k**2 * covariance[..., SENSOR_PLACE, SENSOR_PLACE])
            covariance[..., TEMPERATURE, UNDER_WAY] = covariance[..., UNDER_WAY, TEMPERATURE] = -place * left_k2
        return replace(self, weights=weights, mean=mean, covariance=covariance, has_stood=False)

    def of_healthy_heater(self) -> Belief:
        """Return the Belief with prior weights, and the likeliest filter for every heater."""
        likeliest = int(self.weights.sum(axis=1).argmax())
        mean, covariance = (np.repeat(array[likeliest:likeliest + 1], len(SHARES), axis=0)
                            for array in (self.mean, self.covariance))
        return replace(self, weights=prior_weights(self.weights.sum(axis=0)), mean=mean, covariance=covariance)

    def of_another_route(self) -> Belief:
        """Return the Belief with the prior of the propulsion power's factor, which belongs to a route."""
        mean, covariance = self.mean.copy(), self.covariance.copy()
        _reset(mean, covariance, PROPULSION, 0.0, FACTOR_DEVIATIONS[PROPULSION]**2)
        return replace(self, mean=mean, covariance=covariance)._with_lost_places_afresh()

    def _with_lost_places_afresh(self) -> Belief:
        """
        Return the Belief whose unlikely places of the sensor begin afresh, with the car of the likeliest one.

        With hardly any weight, a filter would learn a car that no reading has to confirm.
        """
        of_places = self.weights.sum(axis=0)
        likeliest, lost = int(of_places.argmax()), of_places < LOST_PLACE
        if not lost.any():
            return self
        mean, covariance = self.mean.copy(), self.covariance.copy()
        logs, variances = np.broadcast_to(self.lags.logs, (len(PLACES), 2)), self.lags.variances
        if self.path.heat_lag_s <= 0.0:
            logs, variances = lags_of_places()
        variances = np.broadcast_to(variances, logs.shape)
        placing, placing_variances = described_placing(self.path)
        for place in np.flatnonzero(lost).tolist():
            own, spread = mean[:, place], covariance[:, place]
            own[:], spread[:] = mean[:, likeliest], covariance[:, likeliest]
            for index, value, variance in (*zip(LAGS, logs[place], variances[place]),
                                           *zip(PLACING, placing[place], placing_variances[place])):
                _reset(own, spread, index, value, variance)
        return replace(self, mean=mean, covariance=covariance)

    def of_stood_car(self) -> Belief:
        """Return the Belief of a car that has stood."""
        return replace(self, has_stood=True)

    def of_free_local_rise(self) -> Belief:
        """Return the Belief with an unknown local rise at the sensor, because readings have shifted for good."""
        covariance = self.covariance.copy()
        covariance[..., LOCAL, LOCAL] += UNKNOWN_K**2
        return replace(self, covariance=covariance)

    # Time

    def _followed_in_core(self, vehicle: Vehicle, duration_s: float, drive: DriveInputs, command_w: float,
                          limit_w: float, propulsion_w: float = 0.0, is_hvch: bool = True) -> Belief:
        car = _car(vehicle)
        native_car, native = vehicle_in_core(car), self._native()
        lost = native.follow(
            native_car, terms_of(vehicle.heat_path), _elapsing(duration_s), drive, car.battery.leakage,
            _heats_w(drive, command_w, limit_w, is_hvch),
            _hidden_s2(drive, duration_s), (
                propulsion_w, drive.propulsion_power_w, *_propulsion_noise(drive.propulsion_power_w, duration_s)))
        return self._of(native)._bounded(lost)

    def _followed(self, vehicle: Vehicle, duration_s: float, drive: DriveInputs, command_w: float, limit_w: float,
                  propulsion_w: float = 0.0, is_hvch: bool = True) -> Belief:
        """
        Return the Belief after `duration_s` [s] in a DriveInputs under a source's command, within its limit [W].

        The drive has floats; its heat is that of all sources but the commanded one. If its terminal power was
        measured, that teaches the propulsion power: `propulsion_w` [W] is the measured power minus all other
        consumers.
        """
        belief = self.mixed(duration_s).moved(
            vehicle, duration_s, drive, command_w, limit_w, is_hvch)
        return belief if drive.terminal_power_w is None else belief.with_propulsion_power(
            propulsion_w, drive.propulsion_power_w, duration_s)

    followed = operation(_followed_in_core, _followed)

    def held(self, vehicle: Vehicle, duration_s: float, command_w: float, interval_c: tuple[float, float] | None,
             interval: tuple[float, float] | None) -> Belief:
        """
        Return the Belief after `duration_s` [s] that the model does not describe, without learning about the car.

        Factors, lags and the weights of the hypotheses stay. Temperature and state of charge follow
        the intervals of their readings [deg C], (0 ... 1); None: no valid reading. Heat under way, with that of
        the heater's command [W], arrives and the sensor approaches the battery's temperature, with their lags.
        """
        covariance = self.covariance.copy()
        # The moving elements are no longer correlated with factors and lags, so that readings do not change these.
        for index in MOVING:
            kept = covariance[..., index, MOVING].copy()
            covariance[..., index, :] = covariance[..., :, index] = 0.0
            covariance[..., index, MOVING] = kept
            covariance[..., MOVING, index] = kept
        sensor_left, heat_left = (
            np.exp(-duration_s / (nominal_s * array_exp(self.mean[..., index])))
            for index, nominal_s in (
                (SENSOR_LAG, NOMINAL_SENSOR_LAG_S), (HEAT_LAG, nominal_heat_lag_s(self.path))))
        local_left = math.exp(-duration_s / LOCAL_LAG_S)
        step = _unchanged()
        step[..., TEMPERATURE, TEMPERATURE] = sensor_left
        step[..., TEMPERATURE, SENSOR] = 1.0 - sensor_left
        step[..., TEMPERATURE, UNDER_WAY] = -self.mean[..., SENSOR_PLACE] * (1.0 - sensor_left)
        step[..., UNDER_WAY, UNDER_WAY] = heat_left
        step[..., LOCAL, LOCAL] = local_left
        covariance = step @ covariance @ np.swapaxes(step, -1, -2)
        wandered = HELD_WANDER**2 * (duration_s / 3600.0)
        wandered[LOCAL] = LOCAL_DEVIATION_K**2 * (1.0 - local_left**2)
        covariance[..., range(SIZE), range(SIZE)] += wandered
        for row, column in ((TEMPERATURE, SENSOR), (SENSOR, TEMPERATURE)):
            covariance[..., row, column] += wandered[TEMPERATURE]
        supplied_k = self._supplied_k(vehicle, duration_s, command_w)
        mean = (step @ self.mean[..., np.newaxis])[..., 0].copy()
        mean[..., UNDER_WAY] += supplied_k
        covariance[..., UNDER_WAY, UNDER_WAY] += (EXCESS_DEVIATION * supplied_k)**2
        belief = replace(self, mean=mean, covariance=covariance)
        if interval_c is not None:
            belief = belief._within(SENSOR, NOISE_VARIANCES, *interval_c, tells_hypotheses=False)
        if interval is not None:
            belief = belief._within(SOC, SOC_NOISE_VARIANCES, *interval, tells_hypotheses=False)
        return belief

    def _supplied_k(self, vehicle: Vehicle, duration_s: float, command_w: float) -> FloatArray:
        """Return the heat under way of each filter that a command [W] of `duration_s` [s] has sent [K]."""
        heater_w = np.array(heater_power_w(command_w, vehicle.hvch.maximum_power_w))[:, np.newaxis]
        k_per_j = vehicle.hvch.efficiency / vehicle.pack_heat_capacity_j_per_k * array_exp(
            self.mean[..., HEATER] - self.mean[..., HEAT_CAPACITY])
        lag_s = nominal_heat_lag_s(self.path) * array_exp(self.mean[..., HEAT_LAG])
        supplied_k: FloatArray = k_per_j * heater_w * lag_s * (1.0 - array_exp(-duration_s / lag_s))
        return supplied_k

    def _left_k(self, duration_s: float) -> FloatArray:
        """Return the heat under way of each filter after `duration_s` [s] without heat [K]."""
        lag_s = nominal_heat_lag_s(self.path) * array_exp(self.mean[..., HEAT_LAG])
        left_k: FloatArray = self.mean[..., UNDER_WAY] * array_exp(-duration_s / lag_s)
        return left_k

    def mixed(self, duration_s: float) -> Belief:
        """Return the Belief with mixed filters, because a heater may have changed from one kind to another."""
        matrix = _elapsing(duration_s).transitions
        # share[from, to, noise]: how much of `to` was `from` before.
        share = matrix[:, :, np.newaxis] * self.weights[:, np.newaxis, :]
        total = share.sum(axis=0)
        share /= total
        mean = np.einsum('abn,ani->bni', share, self.mean)
        off = self.mean[:, np.newaxis] - mean[np.newaxis]
        return replace(self, weights=total, mean=mean, covariance=(
            np.einsum('abn,anij->bnij', share, self.covariance)
            + np.einsum('abn,abni,abnj->bnij', share, off, off)))

    def after_unknown(self, duration_s: float) -> Belief:
        """Return the Belief after `duration_s` [s] of an unknown drive."""
        belief = self.mixed(duration_s)
        wandered = WANDER_UNKNOWN**2 * (duration_s / 3600.0)
        covariance = belief.covariance.copy()
        covariance[..., range(SIZE), range(SIZE)] += wandered
        # The sensor follows the battery.
        for row, column in ((SENSOR, SENSOR), (TEMPERATURE, SENSOR), (SENSOR, TEMPERATURE)):
            covariance[..., row, column] += wandered[TEMPERATURE]
        mean = belief.mean.copy()
        arriving_k = mean[..., UNDER_WAY] - belief._left_k(duration_s)
        mean[..., UNDER_WAY] -= arriving_k
        mean[..., TEMPERATURE] += arriving_k
        mean[..., SENSOR] += (1.0 - mean[..., SENSOR_PLACE]) * arriving_k
        return replace(belief, mean=mean, covariance=covariance)

    def moved(self, vehicle: Vehicle, duration_s: float, drive: DriveInputs, command_w: float,
              limit_w: float, is_hvch: bool = True) -> Belief:
        """Return the Belief after `duration_s` [s] in a DriveInputs, without anything seen; see `followed`."""
        heater_w, source_heat_w = (np.array(heat_w)[:, np.newaxis, np.newaxis] for heat_w in _heats_w(
            drive, command_w, limit_w, is_hvch))
        wander = _elapsing(duration_s).wander
        hidden_s2 = _hidden_s2(drive, duration_s)
        # Heat leaks from the shell, as it would from the core in colder air.
        air_c = drive.ambient_temperature_c - shell_excess_k(self.path, self.mean)[..., np.newaxis]
        after, slopes = moved_with_slopes(
            _car(vehicle), self.mean, replace(drive, heater_power_w=heater_w, source_heat_w=source_heat_w,
                                              ambient_temperature_c=air_c), duration_s)
        step, mean = _unchanged(), self.mean.copy()
        step[..., MOVING, :] = slopes
        mean[..., MOVING] = after
        covariance = step @ self.covariance @ np.swapaxes(step, -1, -2)
        covariance[..., range(SIZE), range(SIZE)] += wander
        # The noise is the mean over all hypotheses: none is likelier because it expects less.
        # The slope of the local rise over the steady rise is proportional to the Joule heat.
        rose = slopes[..., MOVING.index(LOCAL), JOULE_RISE]
        covariance[..., LOCAL, LOCAL] += _rise_noise_k2(duration_s) * np.vdot(self.weights, rose * rose)
        moved = slopes[..., :2, PROPULSION] / duration_s
        covariance[..., :2, :2] += hidden_s2 * np.einsum('ab,abi,abj->ij', self.weights, moved, moved)
        return replace(self, mean=mean, covariance=covariance)

    # Readings

    def with_temperature(self, reading_c: float, resolution_k: float) -> Belief:
        """Return the Belief after a temperature reading [deg C], rounded to `resolution_k` [K]."""
        return self._within(SENSOR, NOISE_VARIANCES, *interval_of(reading_c, resolution_k))

    def with_soc(self, reading: float, resolution: float) -> Belief:
        """Return the Belief after a reading of the state of charge (0 ... 1)."""
        return self._within(
            SOC, SOC_NOISE_VARIANCES, *interval_of(reading, resolution), tells_hypotheses=False)

    def with_propulsion_power(self, seen_w: float, route_w: float, duration_s: float) -> Belief:
        """Return the Belief after the mean propulsion power measured [W], the route's, over `duration_s` [s]."""
        variance, most_w = _propulsion_noise(route_w, duration_s)
        factor = array_exp(self.mean[..., PROPULSION])
        slope = factor * route_w
        gain = self.covariance[..., PROPULSION] * slope[..., np.newaxis]
        total = slope**2 * self.covariance[..., PROPULSION, PROPULSION] + variance
        error_w = np.clip(seen_w - factor * route_w, -most_w, most_w)
        return replace(
            self, mean=self.mean + gain * (error_w / total)[..., np.newaxis],
            covariance=self.covariance - (gain[..., :, np.newaxis] * gain[..., np.newaxis, :]
                                          / total[..., np.newaxis, np.newaxis]))._bounded()

    def _with_battery_in_core(self, temperature_c: float, resolution_k: float, soc: float,
                              resolution: float) -> tuple[Belief, tuple[FloatArray, FloatArray]]:
        native = self._native()
        expected = native.take_reading(
            terms_of(self.path), READING, interval_of(temperature_c, resolution_k), interval_of(soc, resolution))
        return self._of(native), expected

    def _with_battery(self, temperature_c: float, resolution_k: float, soc: float,
                      resolution: float) -> tuple[Belief, tuple[FloatArray, FloatArray]]:
        """Do `with_temperature` and `with_soc`; return also the `expected` mean and covariance."""
        belief = self.with_temperature(temperature_c, resolution_k).with_soc(soc, resolution)
        return belief, belief.expected()

    with_battery = operation(_with_battery_in_core, _with_battery)

    def weighed(self, logs: Sequence[float]) -> Belief:
        """Return the Belief with the heaters' weights after other evidence, by its log-likelihoods (heaters,)."""
        return replace(self, weights=_reweighed(
            self.weights, array_exp(np.subtract(logs, max(logs)))[:, np.newaxis]))

    def with_odds_of(self, before: Belief) -> Belief:
        """Return the Belief with the odds between heaters that are not stuck on of another Belief."""
        own, other = (belief.weights[:STUCK].sum(axis=1) for belief in (self, before))
        weights = self.weights.copy()
        weights[:STUCK] *= (other / other.sum() * own.sum() / own)[:, np.newaxis]
        return replace(self, weights=weights)

    def expected(self) -> tuple[FloatArray, FloatArray]:
        """Return mean (SIZE,) and covariance (SIZE, SIZE) over all hypotheses; read-only."""
        weights = self.weights[..., np.newaxis]
        mean = (weights * self.mean).sum(axis=(0, 1))
        off = self.mean - mean
        covariance = (weights[..., np.newaxis] * (
            self.covariance + off[..., :, np.newaxis] * off[..., np.newaxis, :])).sum(axis=(0, 1))
        return frozen(mean), frozen(covariance)

    def answering_k_per_s(self, vehicle: Vehicle, drive: DriveInputs) -> float:
        """Return the warming of battery and heat under way in DriveInputs if the heater answers [K/s]."""
        weights, state = self.weights[HEALTHY], self.mean[HEALTHY]
        rates_k_per_s, _, _ = state_rates(_car(vehicle), state, replace(
            drive, ambient_temperature_c=drive.ambient_temperature_c - shell_excess_k(self.path, state)))
        return float(weights @ rates_k_per_s / weights.sum())

    def evidence(self, temperature_c: float, resolution_k: float) -> float:
        """Return the log-likelihood of a reading [deg C] with a resolution [K], up to a constant [nats]."""
        covariance = self.covariance
        variance = np.maximum(covariance[..., SENSOR, SENSOR] + 2.0 * covariance[..., SENSOR, LOCAL] + covariance[
            ..., LOCAL, LOCAL] + SIGNAL_NOISE_K**2 + resolution_k**2 / 12.0, LEAST_VARIANCE)
        off_k2 = (self.mean[..., SENSOR] + self.mean[..., LOCAL] - temperature_c)**2
        likelihood = float((self.weights * array_exp(np.maximum(
            -0.5 * off_k2 / variance, -MOST_EVIDENCE)) / np.sqrt(variance)).sum())
        # A belief that is no number is restarted at once.
        return math.log(likelihood) if likelihood > 0.0 else -MOST_NATS

    def _native(self) -> NativeBelief:
        """Return a copy of the filters in the form of the native core."""
        return NativeBelief(self.weights, self.mean, self.covariance)

    def _of(self, native: NativeBelief) -> Belief:
        """Return the Belief with the filters of the native core."""
        return replace(self, weights=native.weights, mean=native.mean, covariance=native.covariance)

    def _within(self, index: int, noise_variance: FloatArray, low: float, high: float,
                tells_hypotheses: bool = True) -> Belief:
        """Kalman update of one element; `noise_variance` (noises,) is added to its own variance."""
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
        return replace(
            self, mean=self.mean + gain * shift[..., np.newaxis],
            covariance=self.covariance - (gain[..., :, np.newaxis] * gain[..., np.newaxis, :]
                                          * kept[..., np.newaxis, np.newaxis]),
            weights=_reweighed(self.weights, array_exp(np.maximum(logs - logs.max(), -MOST_EVIDENCE)))
            if tells_hypotheses else self.weights)._bounded()

    def _bounded(self, lost_filters: int = 1) -> Belief:
        """Return the Belief within its bounds, with lost filters reset; `lost_filters` 0: as it is."""
        if lost_filters == 0:
            return self
        mean, covariance = self.mean.copy(), self.covariance.copy()
        mean[..., BOUNDED] = np.maximum(np.minimum(mean[..., BOUNDED], HIGHEST), LOWEST)
        lost = ((np.abs(mean[..., TEMPERATURE] - mean[..., SENSOR]) > MOST_APART_K)
                | (np.abs(mean[..., UNDER_WAY]) > MOST_APART_K))
        if lost.any():
            mean[lost], covariance[lost] = self._found_again(mean[lost], covariance[lost], np.nonzero(lost)[-1])
        return replace(self, mean=mean, covariance=covariance)

    def _found_again(self, mean: FloatArray, covariance: FloatArray,
                     places: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """Reset the lags and places of lost filters (lost, SIZE), (lost, SIZE, SIZE), and return both."""
        placing, placing_variances = described_placing(self.path)
        for index, value, variance in (
                (TEMPERATURE, mean[:, SENSOR], covariance[:, SENSOR, SENSOR] + UNKNOWN_K**2),
                (UNDER_WAY, 0.0, UNKNOWN_K**2), *zip(LAGS, self.lags.logs, self.lags.variances),
                *zip(PLACING, placing[places].T, placing_variances[places].T)):
            _reset(mean, covariance, index, value, variance)
        return mean, covariance


def _heats_w(drive: DriveInputs, command_w: float, limit_w: float,
             is_hvch: bool) -> tuple[list[float], list[float]]:
    """Return the HVCH's power and other sources' heat [W] of each hypothesis on the source with the command."""
    own_w = heater_power_w(command_w, limit_w)
    one_w, others_w = (drive.heater_power_w, drive.source_heat_w)[::1 if is_hvch else -1]
    heats_w = [power_w + one_w for power_w in own_w], [others_w] * len(own_w)
    return heats_w if is_hvch else heats_w[::-1]


def _car(vehicle: Vehicle) -> Vehicle:
    """Return the Vehicle whose coolant, which warms with the battery, counts as battery; its delay is a lag."""
    return with_coolant_in_battery(vehicle) if vehicle.heat_path.has_coolant else vehicle


def _reset(mean: FloatArray, covariance: FloatArray, index: int, value: float | FloatArray,
           variance: float | FloatArray) -> None:
    """Set an element in means (…, SIZE), and its variance; it is correlated with no other element any more."""
    mean[..., index] = value
    covariance[..., index, :] = covariance[..., :, index] = 0.0
    covariance[..., index, index] = variance


def _unchanged() -> FloatArray:
    """Return the steps (…, SIZE, SIZE) that change nothing."""
    step = np.zeros((*SHAPE, SIZE, SIZE))
    step[..., range(SIZE), range(SIZE)] = 1.0
    return step


def _reweighed(weights: FloatArray, likelihoods: FloatArray) -> FloatArray:
    """Return weights after evidence, with a sum of 1."""
    weights = np.maximum(weights * likelihoods, LEAST_WEIGHT)
    weights /= weights.sum()
    return weights
