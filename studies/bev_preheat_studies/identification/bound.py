# SPDX-License-Identifier: Apache-2.0
"""
The smallest errors that the readings of a synthetic car allow: the Cramer-Rao bound.

It is that of the temperature readings alone: resistance, voltage and capacity are taken as known, the start
temperatures as unknown, and there are no priors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr

from bev_preheat.identification.electrical import fit_electrical
from bev_preheat.identification.fit import Fitter
from bev_preheat.identification.parameters import IN_THE_FILE, NAMES
from bev_preheat_studies.identification.closed_loop import vehicle_with_truth
from bev_preheat_studies.identification.synthetic_car import TEMPERATURE_NOISE_K, TEMPERATURE_STEP_K

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.identification.trips import Trip
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle.description import Vehicle
    from bev_preheat_studies.identification.synthetic_car import SyntheticCar

# Readings farther from the temperature than this number of steps do not occur.
MOST_STEPS = 3
LEAST_PROBABILITY = 1e-12


def relative_bounds(car: SyntheticCar, nominal: Vehicle, trips: Sequence[Trip]) -> dict[str, float]:
    """Return the least relative standard deviation of each thermal parameter that the trips tell, by name."""
    fitter = Fitter(vehicle_with_truth(car, nominal), trips)
    structure = IN_THE_FILE[-1]
    names = fitter.free_names(structure)
    columns = [NAMES.index(name) for name in names]
    electrical = fit_electrical(fitter.vehicle, [])
    theta = np.array([*(fitter.parameters[name].fixed for name in NAMES), *electrical.log_factors])
    information = np.zeros((len(names), len(names)))
    for course in fitter.courses:
        sensor_c, slopes = fitter.sensor_c(fitter.model(structure), course, theta, 0.0, electrical)
        # Each step's readings are those of a temperature constant within it.
        count = course.readings.total * reading_information(sensor_c)
        own, start = slopes[:, columns], slopes[:, -1]
        cross = own.T @ (count * start)
        information += own.T @ (count[:, np.newaxis] * own) - np.outer(cross, cross) / (start @ (count * start))
    told = np.flatnonzero(np.diag(information) > 0.0)
    deviations = np.sqrt(np.diag(np.linalg.inv(information[np.ix_(told, told)])))
    return {names[at]: float(deviation if fitter.parameters[names[at]].is_log
                             else deviation / fitter.parameters[names[at]].value(theta[columns[at]]))
            for at, deviation in zip(told.tolist(), deviations)}


def reading_information(temperature_c: FloatArray) -> FloatArray:
    """Return the Fisher information (N,) [1/K^2] of one noisy, rounded reading of temperatures (N,) [deg C]."""
    steps = np.round(temperature_c / TEMPERATURE_STEP_K)[:, np.newaxis] + np.arange(-MOST_STEPS, MOST_STEPS + 1)
    ends = [((steps + side) * TEMPERATURE_STEP_K - temperature_c[:, np.newaxis]) / TEMPERATURE_NOISE_K
            for side in (-0.5, 0.5)]
    low, high = (np.exp(-0.5 * end**2) / np.sqrt(2.0 * np.pi) / TEMPERATURE_NOISE_K for end in ends)
    probability = ndtr(ends[1]) - ndtr(ends[0])
    return np.asarray(np.where(probability > LEAST_PROBABILITY, (high - low)**2
                               / np.maximum(probability, LEAST_PROBABILITY), 0.0).sum(axis=1))
