# SPDX-License-Identifier: Apache-2.0
"""The result of an identification: estimates with intervals, errors on unseen trips, a verdict."""

from __future__ import annotations

from dataclasses import asdict, dataclass
import math
from typing import Any, TYPE_CHECKING

from bev_preheat.identification.check import rms
from bev_preheat.identification.structures import graded
from bev_preheat.identification.uncertainty import SYSTEMATIC_DEVIATIONS
from bev_preheat.identification.verdict import POOR_RMSE_K

if TYPE_CHECKING:
    from bev_preheat.identification.check import Check
    from bev_preheat.identification.coverage import Coverage
    from bev_preheat.identification.electrical import Electrical
    from bev_preheat.identification.structures import LeftOut, StructureResult
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle.description import Vehicle


@dataclass(frozen=True)
class Estimated:
    """
    A parameter: START's value, estimate, 90 % interval, and what half the interval is worth on arrival [K].

    `is_identified` False: the trips do not tell it, and the estimate is START's value. `prior` explains the prior,
    `prior_low` and `prior_high` are its 90 % interval. `bound` is the bound at which the estimate lies, if any.
    `can_be_0`: 0 is a value like others, as for a share of heat.
    """

    name: str
    label: str
    unit: str
    start: float
    estimate: float
    low: float
    high: float
    prior_low: float
    prior_high: float
    is_identified: bool
    arrival_k: float
    prior: str
    key: str
    bound: float | None = None
    can_be_0: bool = False

    @property
    def is_unusual(self) -> bool:
        """
        Whether the trips tell a value outside the prior's interval, or at its bound.

        A lag is never: it stands for several in a row, and hardly changes an arrival.
        """
        if not self.is_identified or self.name in SYSTEMATIC_DEVIATIONS or (self.can_be_0 and self.bound == 0.0):
            return False
        low = 0.0 if self.can_be_0 else self.prior_low
        return self.bound is not None or not low <= self.estimate <= self.prior_high


@dataclass(frozen=True, eq=False)
class ResistanceCurve:
    """Resistance over temperature [deg C]: START's, estimate, 90 % interval [ohm], and where trips cover it."""

    temperature_c: FloatArray
    start_ohm: FloatArray
    estimate_ohm: FloatArray
    low_ohm: FloatArray
    high_ohm: FloatArray


@dataclass(frozen=True, eq=False)
class Identification:
    """
    An identified car, and how far it can be trusted.

    `vehicle` is the car as its file describes it. `structures` are compared on trips left out, `structure` is the
    chosen one; `left_out` are the errors of its files as plans predict them, `baselines` those of two predictions
    without a model. `check` is the file on all trips. `together` are pairs of parameters known only together.
    `fit_rmse_k` is the root mean square error of the fit on all readings [K].
    """

    vehicle: Vehicle
    start_name: str
    estimates: tuple[Estimated, ...]
    resistance: ResistanceCurve
    electrical: Electrical
    structure: str
    structures: tuple[StructureResult, ...]
    baselines: dict[str, StructureResult]
    left_out: tuple[LeftOut, ...]
    together: tuple[tuple[str, str, float], ...]
    coverage: Coverage
    check: Check
    remarks: tuple[str, ...]
    verdict: tuple[str, ...]
    record_next: tuple[str, ...]
    duration_s: float
    fit_rmse_k: float

    @property
    def rmse_k(self) -> float:
        """Root mean square error on trips left out [K]; NaN if too few trips to leave one out."""
        return rms([trip.error_k for trip in graded(self.left_out)])

    @property
    def worst_k(self) -> float:
        """Largest error on a trip left out [K]; NaN without."""
        return max((abs(trip.error_k) for trip in graded(self.left_out)), default=math.nan)

    @property
    def is_useful(self) -> bool:
        """Whether unseen trips are predicted, or few trips explained, well enough for a vehicle file."""
        return (self.rmse_k if self.left_out else self.fit_rmse_k) <= POOR_RMSE_K

    @property
    def unidentified(self) -> list[str]:
        """Return the labels of the parameters that keep their prior."""
        return [item.label for item in self.estimates if not item.is_identified]

    def as_dictionary(self) -> dict[str, Any]:
        """Return the result in JSON form."""
        curve, electrical = self.resistance, self.electrical
        return {
            'vehicle': self.vehicle.name, 'start': self.start_name, 'structure': self.structure,
            'parameters': [asdict(item) for item in self.estimates],
            'unidentified': self.unidentified,
            'resistance': {name: values.tolist() for name, values in vars(curve).items()},
            'electrical': {
                'heat_factor': electrical.heat_factor, 'polarisation': electrical.polarisation,
                'polarisation_s': electrical.polarisation_s, 'residual_v': electrical.residual_v,
                'voltage_correction_v': electrical.voltage_v.tolist(), 'trips': list(electrical.used)},
            'leave_one_out': {
                'rmse_k': _or_none(self.rmse_k), 'worst_k': _or_none(self.worst_k),
                'trips': [{'name': trip.name, 'arrival_error_k': trip.error_k, 'deviation_k': trip.deviation_k,
                           'is_within_interval': trip.is_within} for trip in self.left_out]},
            'fit_rmse_k': self.fit_rmse_k,
            'structures': [_row(result) for result in self.structures],
            'baselines': [_row(result) for result in self.baselines.values()],
            'known_only_together': [list(pair) for pair in self.together],
            'coverage': self.coverage.as_dictionary(),
            'extrapolated': {'resistance_below_c': self.coverage.resistance_from_c,
                             'resistance_above_c': self.coverage.resistance_to_c},
            'check': self.check.as_dictionary(), 'remarks': list(self.remarks), 'verdict': list(self.verdict),
            'record_next': list(self.record_next), 'duration_s': self.duration_s}


def _row(result: StructureResult) -> dict[str, Any]:
    return {'structure': result.structure, 'rmse_k': _or_none(result.rmse_k), 'worst_k': _or_none(result.worst_k),
            'cost': _or_none(result.cost), 'misfit': _or_none(result.misfit),
            'errors_k': list(map(float, result.errors_k)),
            'in_the_file': result.in_the_file}


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value
