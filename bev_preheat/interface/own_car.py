# SPDX-License-Identifier: Apache-2.0
"""The part of the public interface for recorded drives of one's own car."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TYPE_CHECKING

from bev_preheat.interface.inputs import checked
from bev_preheat.interface.results import Part, Result, rows_frame
from bev_preheat.optional_packages import require

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from bev_preheat.identification.check import Check
    from bev_preheat.identification.result import Identification
    from bev_preheat.logs.recording import Recording
    from bev_preheat.vehicle import Vehicle


@dataclass(frozen=True, eq=False, repr=False)
class CheckResult(Result):
    """How well a vehicle predicts recorded drives: predicted minus measured temperature on arrival."""

    vehicle: Vehicle
    checked: Check

    @property
    def arrival_errors_k(self) -> dict[str, float]:
        """Error on arrival of each recording, by its name [K]."""
        return {trip.trip.name: trip.arrival_error_k for trip in self.checked.trips}

    rmse_k = Part[float]('checked.rmse_k', 'Root mean square of the errors on arrival [K].')
    worst_k = Part[float]('checked.worst_k', 'Largest magnitude of an error on arrival [K].')

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `preheat check`."""
        return self.checked.as_dictionary()

    def to_frame(self) -> DataFrame:
        """Return one row for each recording; needs pandas."""
        return rows_frame(self.to_dict()['trips'], 'name')

    def in_words(self) -> str:
        """Return the errors on arrival as one line."""
        return (f'vehicle {self.vehicle.name}: RMSE {self.rmse_k:.2f} K, worst {self.worst_k:.2f} K on arrival of '
                f'{len(self.checked.trips)} recordings')

    def _figure(self) -> Figure:
        from bev_preheat.drawing.identification_figures import check_figure
        return check_figure(self.checked)

    def _draw(self, axis: Axes) -> None:
        from bev_preheat.drawing.identification_figures import draw_arrival_errors
        draw_arrival_errors(axis, self.checked)


@dataclass(frozen=True, eq=False, repr=False)
class IdentificationResult(Result):
    """An identified car: its Vehicle, and how far it can be trusted."""

    vehicle: Vehicle
    identified: Identification

    rmse_k = Part[float](
        'identified.rmse_k',
        'Root mean square of the errors on arrival [K], each of a fit that has not seen that recording.')
    worst_k = Part[float]('identified.worst_k', 'Largest magnitude of such an error [K].')
    verdict = Part[tuple[str, ...]](
        'identified.verdict', 'Sentences on the trust that the vehicle deserves, the most important first.')
    record_next = Part[tuple[str, ...]](
        'identified.record_next',
        'Sentences on recordings that would improve the vehicle, the most valuable first.')

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `preheat identify`."""
        return self.identified.as_dictionary()

    def to_frame(self) -> DataFrame:
        """Return one row for each parameter: prior, estimate and 90 % interval; needs pandas."""
        return rows_frame(self.to_dict()['parameters'], 'name')

    def in_words(self) -> str:
        """Return the errors on arrival and the verdict's first sentence as one line."""
        return (f'vehicle {self.vehicle.name}: RMSE {self.rmse_k:.2f} K, worst {self.worst_k:.2f} K on arrival'
                + ''.join(f'; {sentence}' for sentence in self.verdict[:1]))

    def _figure(self) -> Figure:
        return self._check._figure()

    def _draw(self, axis: Axes) -> None:
        self._check._draw(axis)

    @property
    def _check(self) -> CheckResult:
        return CheckResult(self.vehicle, self.identified.check)


@checked
def check(vehicle: Vehicle, recordings: Sequence[Recording], replays: bool = True) -> CheckResult:
    """
    Return how well a vehicle predicts recorded drives, as `preheat check` does.

    With `replays` the drives are also replayed to the planner, with its estimation and without. Raises
    InvalidInput, which names log, signal, value and allowed range.
    """
    from bev_preheat.identification.check import check_trips
    from bev_preheat.identification.trips import trips_of
    return CheckResult(vehicle, check_trips(vehicle, trips_of(recordings, vehicle), replays))


@checked
def identify(vehicle: Vehicle, recordings: Sequence[Recording], name: str = 'identified') -> IdentificationResult:
    """
    Return the car that drove the recordings, as `preheat identify` does.

    It needs casadi and scipy (extra `identify`). `vehicle` is the car to start from, `name` the name of the new
    car, which is the attribute `vehicle` of the result. Raises InvalidInput if the recordings give too little.
    """
    require('casadi', 'scipy')
    from bev_preheat.identification.identify import identify as identify_trips
    from bev_preheat.identification.trips import trips_of
    identified = identify_trips(vehicle, trips_of(recordings, vehicle), name)
    return IdentificationResult(identified.vehicle, identified)
