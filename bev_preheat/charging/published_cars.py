# SPDX-License-Identifier: Apache-2.0
"""
Published charging times of cars against computed ones; cars and sources are in published.yaml.

Each time is computed from the data sheet alone (the curve of the car's class), with the published curve, with the
published time from 10 to 80 %, and with the car's shipped file, if it has one.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TYPE_CHECKING

from bev_preheat.charging.published_time import describe_timed_car, PUBLISHED_SPAN, warm_session
from bev_preheat.errors import InvalidInput
from bev_preheat.files.checked_yaml import load_checked_yaml
from bev_preheat.numerics.factors import S_PER_MIN
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.charging_curve import checked_curve, PERCENT
from bev_preheat.vehicle.data_sheet import DataSheet
from bev_preheat.vehicle.loading import vehicle_of_text
from bev_preheat.vehicle.writing import vehicle_text

if TYPE_CHECKING:
    from bev_preheat.files.checked_yaml import FileData
    from bev_preheat.vehicle import Vehicle

FIGURES = Path(__file__).with_name('published.yaml')
SCHEMA = Path(__file__).with_name('published_schema.yaml')


@dataclass(frozen=True)
class ComputedTime:
    """
    A published charging time and its computed counterparts [min], between two states of charge (0 ... 1).

    None if the curve, the time from 10 to 80 % or a shipped file is missing. `fitted_min` of the span from 10 to
    80 % is the published time by construction. `remark` says why times may differ, or is None.
    """

    car: str
    start_soc: float
    end_soc: float
    published_min: float
    source: str
    data_sheet_min: float
    curve_min: float | None
    fitted_min: float | None
    shipped_min: float | None
    remark: str | None = None

    @property
    def is_fitted(self) -> bool:
        """Whether the curve was fitted to this very time."""
        return self.fitted_min is not None and (self.start_soc, self.end_soc) == PUBLISHED_SPAN

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as JSON-compatible data."""
        return asdict(self)


def computed_times(path: Path = FIGURES) -> list[ComputedTime]:
    """Return the ComputedTime of each published time of a file; raise InvalidInput naming file and car."""
    found = []
    for node in load_checked_yaml(path, SCHEMA)['cars']:
        with naming(path, node):
            found += _times_of(node)
    return found


@contextmanager
def naming(path: Path, node: dict[str, FileData]) -> Iterator[None]:
    """Add file and car to the problems of an InvalidInput."""
    try:
        yield
    except InvalidInput as error:
        raise InvalidInput([f'{path}: {node["name"]}: {problem}' for problem in error.problems]) from error


def _times_of(node: dict[str, FileData]) -> list[ComputedTime]:
    sheet = DataSheet(node['name'], **node['data_sheet'])
    times = [(time['from'] / PERCENT, time['to'] / PERCENT, float(time['minutes']), time['source'],
              time.get('remark')) for time in node.get('times', ())]
    for start, end, *_ in times:
        if not start < end:
            raise InvalidInput(f'times: from {PERCENT * start:g} to {PERCENT * end:g} % must rise')
    cars: list[Vehicle | None] = [described(sheet)]
    curve = node.get('curve')
    cars.append(None if curve is None else described(replace(sheet, charging_curve=checked_curve(
        [tuple(point) for point in curve['points']], curve['temperature_c'], curve['source']))))
    usual = [minutes for start, end, minutes, *_ in times if (start, end) == PUBLISHED_SPAN]
    cars.append(described(replace(sheet, charging_time_10_80_min=usual[0])) if usual else None)
    cars.append(load_vehicle(node['vehicle']) if 'vehicle' in node else None)

    def minutes_of(car: Vehicle | None, span: tuple[float, float]) -> float | None:
        return None if car is None else warm_session(car, span).charging_time_s / S_PER_MIN

    found = []
    for start, end, minutes, source, remark in times:
        sheet_min, curve_min, fitted_min, shipped_min = (minutes_of(car, (start, end)) for car in cars)
        assert sheet_min is not None
        found.append(ComputedTime(sheet.name, start, end, minutes, source, sheet_min, curve_min, fitted_min,
                                  shipped_min, remark))
    return found


def described(sheet: DataSheet) -> Vehicle:
    """Return the Vehicle of a DataSheet as `preheat vehicle new` makes it."""
    return vehicle_of_text(vehicle_text(sheet.name, describe_timed_car(sheet), ''), sheet.name)
