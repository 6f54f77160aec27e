# SPDX-License-Identifier: Apache-2.0
"""
Open-circuit voltage, capacity and resistance over temperature, from voltage and current.

The voltage is U_oc(s) - R(T) (I + rho x), where x follows the current with a time constant (one RC pair: fast
polarisation). Hysteresis and slower relaxation are errors that last; the residuals are therefore differenced,
e(t) - phi e(t - 5 s) with phi = exp(-5 s / 30 s), which leaves a seventh of a constant error. The Joule heat of
the model is R I^2, so the file's resistance is the one with the heat of both parts: R (1 + rho <x^2>/<I^2>).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from bev_preheat.identification.curves import knot_weights, KNOTS_C, KNOTS_SOC
from bev_preheat.identification.trips import Trip
from bev_preheat.numerics import ARRAYS, FloatArray
from bev_preheat.tunables import NOMINAL_SENSOR_LAG_S
from bev_preheat.vehicle.description import Vehicle

LASTING_S = 30.0
# Voltage and current are averaged over this time [s], because noise of the current makes the resistance too small.
VOLTAGE_BLOCK_S = 5.0
POLARISATION_S = (4.0, 10.0, 20.0)
# Readings in whole degrees are smoothed over this time [s].
SMOOTHING_S = 121
# Errors of neighbouring rows hang together: this number of rows counts as one observation.
ROWS_PER_OBSERVATION = 20.0
# Rows of one trip, so that a night does not outweigh the drives.
ROWS_OF_A_TRIP = 1500
# Least root mean square of the current's changes within 30 s [A] for a trip that determines the resistance.
LEAST_VARIATION_A = 3.0
# Prior standard deviations: open-circuit voltage as shares of itself (offset, slope and curvature over the whole
# charge), logarithm of the resistance (level, change of the correction from knot to knot),
# the same over the charge, polarisation.
VOLTAGE_DEVIATIONS = (0.15, 0.10, 0.10)
LEVEL_DEVIATION, KNOT_DEVIATION = 0.5, 0.25
SOC_LEVEL_DEVIATION, SOC_KNOT_DEVIATION = 0.01, 0.1
POLARISATION_DEVIATION = 0.5
# What voltage and heat may mean differently by resistance, at any temperature.
SYSTEMATIC_DEVIATION = 0.01
CAPACITY_DEVIATION = 0.10
# A change of charge smaller than this shows nothing of the capacity.
CAPACITY_SOC_CHANGE = 0.05
DISPLAYED_SOC_NOISE = 0.002
OCV = 3
KNOTS = len(KNOTS_C)
BETA = slice(OCV, OCV + KNOTS)
# The resistance's log factors over temperature, then over charge.
LOGS = slice(OCV, OCV + KNOTS + len(KNOTS_SOC))
RHO = LOGS.stop
STATE_SIZE = RHO + 1


def _walk_precision(knots: int, level_deviation: float, step_deviation: float) -> FloatArray:
    """Return the prior precision (knots, knots) of log factors: a level and a random walk."""
    steps = np.diff(np.eye(knots), axis=0) / step_deviation
    level = np.full((1, knots), 1.0 / knots) / level_deviation
    return np.asarray(steps.T @ steps + level.T @ level)


@dataclass(frozen=True, eq=False)
class Electrical:
    """
    Result of the fit.

    `voltage_v` are offset, slope and curvature [V]; `log_factors` (knots,) correct START's resistance over
    temperature, with their `covariance`, `soc_factors` over the charge, 0 in the mean over the drives;
    `polarisation` is rho, `heat_factor` 1 + rho <x^2>/<I^2>, `residual_v` the root mean square of the differenced
    residuals. `capacity_ah` has a `capacity_deviation_ah`. `used` names the trips that tell resistance; empty: all
    is prior.
    """

    voltage_v: FloatArray
    log_factors: FloatArray
    soc_factors: FloatArray
    covariance: FloatArray
    polarisation: float
    polarisation_s: float
    heat_factor: float
    residual_v: float
    capacity_ah: float
    capacity_deviation_ah: float
    used: tuple[str, ...]


class _Rows:
    """One trip's differenced rows of the voltage equation."""

    def __init__(self, vehicle: Vehicle, trip: Trip, capacity_ah: float, polarisation_s: float) -> None:
        assert trip.voltage_v is not None and trip.current_a is not None
        current_a = trip.current_a
        soc = np.clip(float(np.median(trip.soc[:5])) - np.cumsum(current_a) / (3600.0 * capacity_ah), 0.01, 1.0)
        smooth = np.ones(SMOOTHING_S)
        temperature_c = (np.convolve(trip.battery_temperature_c, smooth, 'same')
                         / np.convolve(np.ones(len(trip)), smooth, 'same'))
        # The sensor shows the battery's temperature late.
        late = min(round(vehicle.heat_path.sensor_lag_s or NOMINAL_SENSOR_LAG_S), len(trip) - 1)
        temperature_c = np.concatenate((temperature_c[late:], np.repeat(temperature_c[-1:], late)))
        battery = vehicle.battery
        open_v = battery.open_circuit_voltage.function(ARRAYS)(soc, temperature_c)
        resistance = battery.resistance.function(ARRAYS)(soc, temperature_c)
        left = math.exp(-1.0 / polarisation_s)
        follows_a = lfilter([1.0 - left], [1.0, -left], current_a, zi=[left * current_a[0]])[0]
        self.heat_share = float(np.mean(follows_a**2) / max(np.mean(current_a**2), 1e-9))
        self.square_a2 = float(np.mean(current_a**2))
        keeps = math.exp(-VOLTAGE_BLOCK_S / LASTING_S)
        blocks = np.arange(0.0, len(trip) + 1.0, VOLTAGE_BLOCK_S)
        stride = -(-len(blocks) // ROWS_OF_A_TRIP)

        def differenced(values: FloatArray) -> FloatArray:
            means = trip.means(values, blocks)
            return np.asarray((means[1:] - keeps * means[:-1])[::stride])

        centred = soc - 0.5
        self.error_v = differenced(open_v - trip.voltage_v)
        self.voltage = np.stack([differenced(column) for column in (
            np.ones_like(soc), centred, centred**2)], axis=-1)
        weights = np.concatenate((knot_weights(temperature_c, KNOTS_C), knot_weights(soc, KNOTS_SOC)), axis=1)
        # The knots' part is not differenced before it is multiplied: R is at both instants nearly the same.
        self.weights = weights[int(VOLTAGE_BLOCK_S)::int(VOLTAGE_BLOCK_S)][:len(blocks) - 2][::stride]
        self.drop_v, self.polarised_v = differenced(resistance * current_a), differenced(resistance * follows_a)

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals [V] (rows,) and their slopes (rows, STATE_SIZE)."""
        factor = np.exp(self.weights @ theta[LOGS])
        dropped = factor * (self.drop_v + theta[RHO] * self.polarised_v)
        slopes = np.concatenate((self.voltage, -self.weights * dropped[:, np.newaxis],
                                 -(factor * self.polarised_v)[:, np.newaxis]), axis=1)
        return self.error_v + self.voltage @ theta[:OCV] - dropped, slopes


def fit_electrical(vehicle: Vehicle, trips: Sequence[Trip]) -> Electrical:
    """Return the Electrical of Trips."""
    capacity = _capacity(vehicle, trips)
    telling = [trip for trip in trips if trip.current_a is not None and trip.voltage_v is not None
               and len(trip) > 10 and np.std(np.diff(trip.current_a[::5])) > LEAST_VARIATION_A]
    precision = _prior_precision(vehicle)
    if not telling:
        prior = np.asarray(np.linalg.inv(precision), dtype=float)
        return Electrical(np.zeros(OCV), np.zeros(KNOTS), np.zeros(len(KNOTS_SOC)), prior[BETA, BETA],
                          0.0, 0.0, 1.0, math.nan, *capacity, ())
    fits = (_fit(vehicle, telling, capacity, polarisation_s, precision) for polarisation_s in POLARISATION_S)
    return min(fits, key=lambda found: found[0])[1]


def _fit(vehicle: Vehicle, telling: Sequence[Trip], capacity: tuple[float, float], polarisation_s: float,
         precision: FloatArray) -> tuple[float, Electrical]:
    """Return the cost of a fit with a time constant of the polarisation, and its Electrical."""
    rows = [_Rows(vehicle, trip, capacity[0], polarisation_s) for trip in telling]
    prior_root = np.linalg.cholesky(precision).T
    # A first guess of the noise, then that of the residuals: only the balance with the prior depends on it.
    noise_v, theta = 5.0, np.zeros(STATE_SIZE)
    lowest, highest = np.full(STATE_SIZE, -np.inf), np.full(STATE_SIZE, np.inf)
    lowest[RHO], highest[RHO] = 0.0, 5.0
    theta[RHO] = 0.1
    for _ in range(2):
        def residuals(values: FloatArray, noise_v: float = noise_v) -> FloatArray:
            return np.concatenate([row.residuals(values)[0] / noise_v for row in rows] + [prior_root @ values])

        def slopes(values: FloatArray, noise_v: float = noise_v) -> FloatArray:
            return np.concatenate([row.residuals(values)[1] / noise_v for row in rows] + [prior_root])

        found = least_squares(residuals, theta, slopes, bounds=(lowest, highest), x_scale=_SCALES, loss='soft_l1')
        theta = found.x
        parts = [row.residuals(theta) for row in rows]
        all_v = np.concatenate([errors_v for errors_v, _ in parts])
        spread_v = float(1.4826 * np.median(np.abs(all_v - np.median(all_v))))
        noise_v = max(spread_v, 1e-3) * math.sqrt(ROWS_PER_OBSERVATION)
    gradients, information = [], precision.copy()
    for errors_v, slope in parts:
        weight = noise_v**-2 / np.sqrt(1.0 + (errors_v / noise_v)**2)
        information += slope.T @ (weight[:, np.newaxis] * slope)
        gradients.append(slope.T @ (weight * errors_v))
    covariance = sandwich(information, np.array(gradients).T @ np.array(gradients), len(gradients), precision)
    heat_share = float(np.average([row.heat_share for row in rows], weights=[row.square_a2 for row in rows]))
    heat_factor = 1.0 + theta[RHO] * heat_share
    # The mean over the drives of the correction over charge counts as one over temperature.
    soc_weights = np.sum([row.drop_v**2 @ row.weights[:, KNOTS:] for row in rows], axis=0)
    soc_factors, means = theta[BETA.stop:LOGS.stop], soc_weights / soc_weights.sum()
    joined = np.concatenate((np.eye(KNOTS), np.tile(means, (KNOTS, 1))), axis=1)
    return found.cost, Electrical(
        theta[:OCV], joined @ theta[LOGS] + math.log(heat_factor), soc_factors - means @ soc_factors,
        np.asarray(joined @ covariance[LOGS, LOGS] @ joined.T + SYSTEMATIC_DEVIATION**2, dtype=float),
        float(theta[RHO]), polarisation_s, float(heat_factor), float(np.sqrt(np.mean(all_v**2))), *capacity,
        tuple(trip.name for trip in telling))


def sandwich(information: FloatArray, squares: FloatArray, trips: int, precision: FloatArray) -> FloatArray:
    """
    Return a covariance (n, n) from the information, the prior's precision and the trips' gradients.

    Each trip counts as one observation ("sandwich" estimate), because errors within a trip hang together.
    `squares` (n, n) is the sum of the outer products of the gradients.
    """
    inverse = np.linalg.inv(information)
    spread = squares * (trips / max(trips - 1.0, 1.0))
    return np.asarray(inverse @ (spread + precision) @ inverse)


_SCALES = np.array([10.0, 10.0, 10.0, *[0.2] * (LOGS.stop - OCV), 0.2])


def _prior_precision(vehicle: Vehicle) -> FloatArray:
    nominal_v = float(vehicle.battery.open_circuit_voltage.function(ARRAYS)(np.array([0.5]), np.array([20.0]))[0])
    precision = np.zeros((STATE_SIZE, STATE_SIZE))
    precision[range(OCV), range(OCV)] = 1.0 / np.square(np.array(VOLTAGE_DEVIATIONS) * nominal_v)
    precision[BETA, BETA] = _walk_precision(KNOTS, LEVEL_DEVIATION, KNOT_DEVIATION)
    precision[BETA.stop:LOGS.stop, BETA.stop:LOGS.stop] = _walk_precision(
        len(KNOTS_SOC), SOC_LEVEL_DEVIATION, SOC_KNOT_DEVIATION)
    precision[RHO, RHO] = 1.0 / POLARISATION_DEVIATION**2
    return precision


def _capacity(vehicle: Vehicle, trips: Sequence[Trip]) -> tuple[float, float]:
    """Return capacity and its deviation [Ah] from charge drawn over change of charge."""
    prior_ah = vehicle.battery.capacity_ah
    precision, total = 1.0 / (CAPACITY_DEVIATION * prior_ah)**2, 1.0 / (CAPACITY_DEVIATION**2 * prior_ah)
    for trip in trips:
        fell = float(trip.soc[0] - trip.soc[-1])
        if trip.current_a is None or abs(fell) < CAPACITY_SOC_CHANGE:
            continue
        steps = np.abs(np.diff(np.unique(trip.soc)))
        noise = math.hypot(DISPLAYED_SOC_NOISE, float(np.min(steps)) / math.sqrt(6.0) if len(steps) else 0.0)
        # drawn = C fell, with an error of C noise
        drawn_ah = float(np.sum(trip.current_a) / 3600.0)
        precision += (fell / (prior_ah * noise))**2
        total += fell * drawn_ah / (prior_ah * noise)**2
    return total / precision, 1.0 / math.sqrt(precision)
