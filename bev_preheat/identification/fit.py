# SPDX-License-Identifier: Apache-2.0
"""Least squares over trips: thermal parameters under their priors, with the resistance found from the voltage."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np
from scipy.optimize import least_squares

from bev_preheat.identification.electrical import Electrical, sandwich
from bev_preheat.identification.parameters import ALL_STRUCTURES, NAMES, parameters_of
from bev_preheat.identification.readings import likely_noise_k, ReadingResiduals
from bev_preheat.identification.thermal import Course, course_of, PARAMETERS, ThermalModel
from bev_preheat.identification.trips import LEAST_TRIPS, Trip
from bev_preheat.numerics import BoolArray, FloatArray
from bev_preheat.vehicle.description import Vehicle

# Readings that count as one independent observation against the priors: at least, at most (a quarter of an hour).
LEAST_DISPERSION, MOST_DISPERSION = 1.0, 900.0
# Fewer trips do not show how far readings of one trip hang together: those of nine drives of an i3 do by this
# factor (docs/how-to/identify.md).
USUAL_DISPERSION = 40.0
# The start temperature lies in the interval of the first reading; a lagging sensor widens it [K].
START_NOISE_K = 0.2
# Standard deviation and bound of the difference between cells and battery as a whole at parking [K].
UNSETTLED_K, MOST_UNSETTLED_K = 1.0, 8.0
# A reading is the sensor's: with a coarse step the cell may be anywhere in it.
SHARE_OF_STEP = 1.0 / math.sqrt(12.0)
MOST_EVALUATIONS = 60
# With a slow shell a fit that begins at the prior may end with a slow sensor in its place; it also begins here.
AIR_GAP_W_PER_K = 60.0
MISFIT_STEPS = 2
# Relative: half a sum of squares of 1000 is found to 0.01.
FIT_TOLERANCE = 1e-5


@dataclass(frozen=True, eq=False)
class ThermalFit:
    """
    A fit: coordinates (PARAMETERS,), which of them are `free`, their `covariance`, and each trip's start [deg C].

    `information` (free, free) includes the prior; `gradients` (trips, free) and `informations` (trips, free, free)
    are the trips' parts. `cost` is half the sum of squares.
    """

    structure: str
    theta: FloatArray
    free: BoolArray
    information: FloatArray
    prior_precision: FloatArray
    gradients: FloatArray
    informations: FloatArray
    starts_c: tuple[float, ...]
    electrical: Electrical
    cost: float

    @property
    def covariance(self) -> FloatArray:
        """Return the covariance (PARAMETERS, PARAMETERS): 0 for fixed parameters."""
        whole, trips = np.zeros((PARAMETERS, PARAMETERS)), len(self.gradients)
        whole[np.ix_(self.free, self.free)] = (
            np.linalg.inv(self.information) if trips < LEAST_TRIPS else
            sandwich(self.information, self.gradients.T @ self.gradients, trips, self.prior_precision))
        return whole


class Fitter:
    """Fits structures to subsets of Trips of one START vehicle."""

    def __init__(self, vehicle: Vehicle, trips: Sequence[Trip]) -> None:
        self.vehicle, self.trips = vehicle, tuple(trips)
        self.parameters = parameters_of(vehicle)
        self.courses = [course_of(trip, vehicle) for trip in trips]
        # The same without the hours in which nights settle, which a file cannot predict.
        self.settled = [course_of(trip.settled, vehicle) for trip in trips]
        self.models = {name: ThermalModel(vehicle, structure.free, structure)
                       for name, structure in ALL_STRUCTURES.items()}
        self._residuals = [ReadingResiduals(course.readings) for course in self.courses]
        # Readings that count as one independent observation.
        self.dispersion = LEAST_DISPERSION

    def find_dispersion(self, electrical: Electrical, structures: Iterable[str]) -> None:
        """
        Set the readings' noise and `dispersion` from the best fit of `structures` to all trips.

        If the model were exact, the trips' gradients would vary as their information says. They vary more by the
        factor that is found here, because errors of model and sensor last (quasi-likelihood).
        """
        fit = min((self.fit(structure, electrical) for structure in structures), key=lambda fit: fit.cost)
        noise_k = likely_noise_k([course.readings for course in self.courses], self._sensors_c(fit))
        self._residuals = [ReadingResiduals(course.readings, noise_k) for course in self.courses]
        if len(self.trips) < LEAST_TRIPS:
            self.dispersion = USUAL_DISPERSION
            return
        fit = self.fit(fit.structure, electrical, fit)
        inverse = np.linalg.inv(fit.information)
        gradients = fit.gradients - fit.gradients.mean(axis=0)
        own = fit.information - fit.prior_precision
        count = len(gradients)
        ratio = (np.einsum('ti,ij,tj->', gradients, inverse, gradients) * count / max(count - 1.0, 1.0)
                 / max(float(np.trace(own @ inverse)), 1e-9))
        self.dispersion = min(max(float(ratio), LEAST_DISPERSION), MOST_DISPERSION)

    def fit(self, structure: str, electrical: Electrical, begin: ThermalFit | None = None,
            held: Mapping[str, float] | None = None, left_out: int | None = None) -> ThermalFit:
        """
        Return the ThermalFit of a structure to all trips, without the one `left_out` (its index).

        `electrical` is that of these trips, `begin` a fit to all trips to begin at; `held` maps names to the
        coordinates at which they are held.
        """
        indices = [at for at in range(len(self.trips)) if at != left_out]
        model, names = self.models[structure], ALL_STRUCTURES[structure].free
        has_heating = any(self.trips[at].heats for at in indices)
        free = np.array([name in names and (has_heating or name != 'heat_lag') for name in NAMES]
                        + [True] * (PARAMETERS - len(NAMES)))
        prior, low, high = self._prior(electrical)
        theta = prior.copy()
        for at, name in enumerate(NAMES):
            if not free[at]:
                theta[at] = prior[at] = self.parameters[name].fixed
        offsets_k = np.zeros(len(indices))
        if begin is not None:
            theta[free] = begin.theta[free]
            offsets_k[:] = [begin.starts_c[at] - self.trips[at].start_c for at in indices]
        for name, coordinate in (held or {}).items():
            at = NAMES.index(name)
            free[at], theta[at] = False, coordinate
        precision = self._precision(electrical)[np.ix_(free, free)]
        prior_root = np.linalg.cholesky(precision).T
        count = int(free.sum())
        courses = [self.courses[at] for at in indices]
        start_deviations_k = np.array([start_deviation_k(course) for course in courses])
        cache: dict[bytes, tuple[FloatArray, FloatArray]] = {}

        def evaluate(values: FloatArray) -> tuple[FloatArray, FloatArray]:
            key = values.tobytes()
            if key not in cache:
                cache.clear()
                theta[free] = values[:count]
                residuals, slopes = [], []
                for at, index in enumerate(indices):
                    residual, slope = self.trip_residuals(model, index, theta, values[count + at], electrical)
                    row = np.zeros((len(residual), len(values)))
                    row[:, :count], row[:, count + at] = slope[:, :-1][:, free], slope[:, -1]
                    residuals.append(residual)
                    slopes.append(row)
                rest = np.zeros((count + len(courses), len(values)))
                rest[:count, :count] = prior_root
                rest[range(count, len(values)), range(count, len(values))] = 1.0 / start_deviations_k
                residuals.append(np.concatenate((prior_root @ (values[:count] - prior[free]),
                                                 values[count:] / start_deviations_k)))
                cache[key] = np.concatenate(residuals), np.concatenate([*slopes, rest])
            return cache[key]

        reach_k = np.array([max(course.trip.resolution_k, 0.2) if course.settling is None else MOST_UNSETTLED_K
                            for course in courses])
        lowest, highest = np.concatenate((low[free], -reach_k)), np.concatenate((high[free], reach_k))
        guesses = [np.concatenate((theta[free], offsets_k))]
        conductance = NAMES.index('shell_conductance')
        if begin is None and free[conductance]:
            theta[conductance] = math.log(AIR_GAP_W_PER_K)
            guesses.append(np.concatenate((theta[free], offsets_k)))
        found = min((least_squares(
            lambda values: evaluate(values)[0], np.clip(guess, lowest + 1e-9, highest - 1e-9),
            lambda values: evaluate(values)[1], bounds=(lowest, highest), x_scale='jac',
            max_nfev=MOST_EVALUATIONS, ftol=FIT_TOLERANCE, xtol=FIT_TOLERANCE) for guess in guesses),
            key=lambda each: each.cost)
        theta[free] = found.x[:count]
        residuals, slopes = evaluate(found.x)
        terms, at = [], 0
        for number, course in enumerate(courses):
            rows = slice(at, at + len(course.read))
            at = rows.stop
            terms.append(_terms(residuals[rows], slopes[rows, :count], slopes[rows, count + number],
                                found.x[count + number], start_deviations_k[number]))
        gradients, informations = map(np.array, zip(*terms))
        return ThermalFit(structure, theta.copy(), free, precision + sum(informations), precision, gradients,
                          informations,
                          tuple(course.trip.start_c + offset for course, offset in zip(courses, found.x[count:])),
                          electrical, float(found.cost))

    def trip_residuals(self, model: ThermalModel, at: int, theta: FloatArray, start_offset_k: float,
                       electrical: Electrical) -> tuple[FloatArray, FloatArray]:
        """Return weighted residuals (K,) of a trip's readings and their slopes (K, PARAMETERS + 1)."""
        sensor_c, slopes = self._sensor_c(model, self.courses[at], theta, start_offset_k, electrical)
        residual, slope = self._residuals[at](sensor_c)
        weight = math.sqrt(1.0 / self.dispersion)
        return weight * residual, (weight * slope)[:, np.newaxis] * slopes

    def residual_k(self, fit: ThermalFit) -> float:
        """Return the root mean square of a fit's errors on the readings of all trips [K]."""
        errors_k = [sensor_c - course.readings.mean_c
                    for sensor_c, course in zip(self._sensors_c(fit), self.courses)]
        return float(np.sqrt(np.mean(np.concatenate(errors_k)**2)))

    def misfit(self, fit: ThermalFit, at: int) -> float:
        """Return half the sum of squares of a trip's residuals with a fit that need not know it."""
        model, offset_k, deviation_k = self.models[fit.structure], 0.0, start_deviation_k(self.courses[at])
        for _ in range(MISFIT_STEPS):
            # Gauss-Newton in the start temperature.
            residual, slope = self.trip_residuals(model, at, fit.theta, offset_k, fit.electrical)
            own = slope[:, -1]
            offset_k -= float((own @ residual + offset_k / deviation_k**2) / (own @ own + 1.0 / deviation_k**2))
        residual, _ = self.trip_residuals(model, at, fit.theta, offset_k, fit.electrical)
        return 0.5 * float(residual @ residual + (offset_k / deviation_k)**2)

    def _sensors_c(self, fit: ThermalFit) -> list[FloatArray]:
        """Return the sensor temperatures at each course's readings [deg C] with a fit to all trips."""
        model = self.models[fit.structure]
        return [self._sensor_c(model, course, fit.theta, start_c - course.trip.start_c, fit.electrical)[0]
                for course, start_c in zip(self.courses, fit.starts_c)]

    def _sensor_c(self, model: ThermalModel, course: Course, theta: FloatArray, start_offset_k: float,
                  electrical: Electrical) -> tuple[FloatArray, FloatArray]:
        """Return sensor temperatures at a course's readings (K,) [deg C], and their slopes (K, PARAMETERS + 1)."""
        start_c = course.trip.start_c + start_offset_k
        readings_c, slopes = model.course(course, theta, start_c, electrical)
        start_slopes = np.zeros(PARAMETERS + 1)
        start_slopes[-1] = 1.0
        if course.settling is not None:
            # The first reading is as it is; the offset is that of cells to the whole battery, and passes.
            readings_c, slopes, start_c = readings_c - start_offset_k * course.settling, slopes.copy(), (
                course.trip.start_c)
            slopes[:, -1] -= course.settling
            start_slopes[-1] = 0.0
        return course.within_steps(start_c, readings_c), course.within_steps(start_slopes, slopes)

    def _prior(self, electrical: Electrical) -> tuple[FloatArray, FloatArray, FloatArray]:
        own = [self.parameters[name] for name in NAMES]
        bound = np.full(len(electrical.log_factors), 3.0)
        return (np.concatenate(([item.prior for item in own], electrical.log_factors)),
                np.concatenate(([item.low for item in own], electrical.log_factors - bound)),
                np.concatenate(([item.high for item in own], electrical.log_factors + bound)))

    def _precision(self, electrical: Electrical) -> FloatArray:
        precision = np.zeros((PARAMETERS, PARAMETERS))
        own = range(len(NAMES))
        precision[own, own] = [1.0 / self.parameters[name].deviation**2 for name in NAMES]
        precision[len(NAMES):, len(NAMES):] = np.linalg.inv(electrical.covariance)
        return precision


def start_deviation_k(course: Course) -> float:
    """Return the standard deviation of the battery temperature at the first reading [K]."""
    return (math.hypot(SHARE_OF_STEP * course.trip.resolution_k, START_NOISE_K) if course.settling is None
            else UNSETTLED_K)


def _terms(residual: FloatArray, slope: FloatArray, start_slope: FloatArray, start_offset_k: float,
           start_deviation_k: float) -> tuple[FloatArray, FloatArray]:
    """Return a trip's gradient and information with its start temperature eliminated (Schur complement)."""
    information, gradient = slope.T @ slope, slope.T @ residual
    cross, own = slope.T @ start_slope, start_slope @ start_slope + 1.0 / start_deviation_k**2
    start_gradient = start_slope @ residual + start_offset_k / start_deviation_k**2
    return gradient - cross * (start_gradient / own), information - np.outer(cross, cross) / own
