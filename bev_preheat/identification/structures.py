# SPDX-License-Identifier: Apache-2.0
"""Structures of the model by their errors on trips that the fit has not seen, beside two baselines."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.identification.check import predict, rms
from bev_preheat.identification.parameters import NAMES, STRUCTURES
from bev_preheat.identification.trips import LEAST_TRIPS
from bev_preheat.identification.uncertainty import QUANTILE
from bev_preheat.identification.vehicle_file import identified_vehicle

if TYPE_CHECKING:
    from bev_preheat.identification.electrical import Electrical
    from bev_preheat.identification.fit import Fitter, ThermalFit
    from bev_preheat.numerics import FloatArray

# A structure other than the first must explain the readings of unseen trips better by this part of the misfit for
# each of its own parameters, and by the standard error of the gain; to be tried on them, those of all trips.
LEAST_MISFIT_GAIN = 2.0
SENSOR_NOISE_K = 0.1
# From this error on [K] the equations diverge; no battery errs so much.
MOST_ERROR_K = 200.0


@dataclass(frozen=True)
class StructureResult:
    """A structure's fit cost; negative log-likelihoods of readings and errors [K] on trips left out."""

    structure: str
    cost: float
    misfits: tuple[float, ...]
    errors_k: tuple[float, ...]

    @property
    def diverges(self) -> bool:
        """Whether its equations do not hold together on a trip left out: an error that no battery has."""
        return not all(abs(error_k) < MOST_ERROR_K for error_k in self.errors_k)

    @property
    def rmse_k(self) -> float:
        """Root mean square of the errors [K]."""
        return rms(self.errors_k)

    @property
    def worst_k(self) -> float:
        """Largest error [K]; NaN without any."""
        return max(map(abs, self.errors_k), default=math.nan)


@dataclass(frozen=True)
class LeftOut:
    """
    A trip left out: error on arrival of the file fitted to the others [K], as plans predict it.

    `deviation_k` is the standard deviation of that error by the parameters' uncertainty and the sensor's step.
    `kind` is that of the trip.
    """

    name: str
    error_k: float
    deviation_k: float
    kind: str = 'drive'

    @property
    def is_within(self) -> bool:
        """Whether the 90 % interval of the error contains it."""
        return abs(self.error_k) <= QUANTILE * self.deviation_k


def graded(left_out: Sequence[LeftOut]) -> list[LeftOut]:
    """
    Return the LeftOuts that grade a file: those with another trip of their kind.

    Without the only night no other trip determines the leakage at stand, so it does not grade the file.
    """
    kinds = [trip.kind for trip in left_out]
    return [trip for trip in left_out if kinds.count(trip.kind) > 1] or list(left_out)


def try_structures(fitter: Fitter, structures: Iterable[str], whole: Electrical, electricals: Sequence[Electrical],
                   tell: Callable[[str], None]) -> tuple[list[StructureResult], dict[str, ThermalFit]]:
    """Return results of the structures that may be chosen, and their fits to all trips; `tell` gets each name."""
    results: list[StructureResult] = []
    fits: dict[str, ThermalFit] = {}
    if len(fitter.trips) < LEAST_TRIPS:
        electricals = ()
    for structure in structures:
        tell(f'structure: {structure}')
        fit = fitter.fit(structure, whole)
        # A shell whose share lies at its bound stands in for a lag, and plans would protect it from overheating.
        has_no_shell = STRUCTURES[structure].has_shell and fitter.parameters['shell_share'].bound_at(
            float(fit.theta[NAMES.index('shell_share')])) is not None
        if results and (has_no_shell or fit.cost > min(result.cost for result in results) - LEAST_MISFIT_GAIN):
            continue
        fits[structure], errors_k, misfits = fit, [], []
        for at, electrical in enumerate(electricals):
            tell(f'structure: {structure}, without {fitter.trips[at].name}')
            without = fitter.fit(structure, electrical, fit, left_out=at)
            course = fitter.settled[at]
            trip = course.trip
            readings_c, _ = fitter.models[structure].course(course, without.theta, trip.start_c, electrical)
            errors_k.append(float(readings_c[-1]) - trip.arrival_c)
            misfits.append(fitter.misfit(without, at))
        results.append(StructureResult(structure, fit.cost, tuple(misfits), tuple(errors_k)))
    return results, fits


def misfit_gains(one: StructureResult, other: StructureResult, kinds: Sequence[str]) -> FloatArray:
    """
    Return by how much another structure explains each trip left out better; `kinds` are those of all trips.

    A lonely trip of its kind is not counted: the others do not determine its part of the model.
    """
    told = [kinds.count(kind) > 1 for kind in kinds]
    return (np.array(one.misfits) - np.array(other.misfits))[told] if one.misfits else np.zeros(0)


def chosen_structure(results: Sequence[StructureResult], kinds: Sequence[str]) -> str:
    """Return the first structure unless another explains unseen trips better; `kinds` are those of all trips."""
    best, *others = results
    for result in others:
        gains = misfit_gains(best, result, kinds)
        error = math.sqrt(len(gains)) * float(gains.std(ddof=1)) if len(gains) else 0.0
        if gains.sum() > max(LEAST_MISFIT_GAIN * len(STRUCTURES[result.structure].names), error):
            best = result
    return best.structure


def leave_each_out(fitter: Fitter, fit: ThermalFit, electricals: Sequence[Electrical],
                   held: Mapping[str, float], tell: Callable[[str], None]) -> list[LeftOut]:
    """Return the LeftOut of each trip, predicted by the file that the others would give; none of few trips."""
    found: list[LeftOut] = []
    if len(fitter.trips) < LEAST_TRIPS:
        return found
    for at, electrical in enumerate(electricals):
        course = fitter.settled[at]
        trip = course.trip
        tell(f'leaving out {trip.name}')
        without = fitter.fit(fit.structure, electrical, fit, held, at)
        car = identified_vehicle(fitter, without)
        error_k = float(predict(car, trip).reading_c[-1]) - trip.arrival_c
        _, slopes = fitter.models[fit.structure].course(course, without.theta, trip.start_c, electrical)
        slope = slopes[-1, :-1]
        step_k = trip.resolution_k / math.sqrt(12.0)
        found.append(LeftOut(trip.name, error_k, math.sqrt(
            float(slope @ without.covariance @ slope) + (1.0 + float(slopes[-1, -1])**2) * (
                step_k**2 + SENSOR_NOISE_K**2)), trip.kind))
    # With a common error of the model the deviations explain the errors.
    missing = float(np.mean([trip.error_k**2 - trip.deviation_k**2 for trip in graded(found)]))
    return [replace(trip, deviation_k=math.sqrt(trip.deviation_k**2 + max(missing, 0.0))) for trip in found]


def baselines(fitter: Fitter) -> dict[str, StructureResult]:
    """Return the leave-one-out errors of a constant temperature and of a regression on the integral of I^2."""
    if len(fitter.trips) < LEAST_TRIPS:
        return {}
    warmed_k = np.array([trip.arrival_c - trip.start_c for trip in fitter.trips])
    squares = np.array([float(np.sum((trip.power_w + trip.heater_w)**2)) if trip.current_a is None
                        else float(np.sum(trip.current_a**2)) for trip in fitter.trips])
    columns = np.stack((np.ones_like(squares), squares / max(float(squares.max()), 1e-9)), axis=1)
    errors_k = []
    for at in range(len(squares)):
        coefficients, *_ = np.linalg.lstsq(
            np.delete(columns, at, axis=0), np.delete(warmed_k, at), rcond=None)
        errors_k.append(float(columns[at] @ coefficients - warmed_k[at]))
    found = {'constant temperature': tuple(-warmed_k), 'regression on I^2': tuple(errors_k)}
    return {name: StructureResult(name, math.nan, (), errors) for name, errors in found.items()}
