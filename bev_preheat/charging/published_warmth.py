# SPDX-License-Identifier: Apache-2.0
"""
Published battery temperatures against computed ones: heating runs of owners, and rises in charging sessions.

The cars are described from their data sheets alone (published.yaml).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.charging.published_cars import described, FIGURES, naming, SCHEMA
from bev_preheat.charging.session import charge
from bev_preheat.charging.stop import ChargingStop
from bev_preheat.errors import InvalidInput
from bev_preheat.files.checked_yaml import load_checked_yaml
from bev_preheat.numerics.factors import S_PER_MIN, W_PER_KW
from bev_preheat.planning.engine import run_forward
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle.charging import session_charging
from bev_preheat.vehicle.charging_curve import PERCENT
from bev_preheat.vehicle.data_sheet import DataSheet
from bev_preheat.vehicle.model import make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.files.checked_yaml import FileData
    from bev_preheat.vehicle import Vehicle

MPS_PER_KMH = 1.0 / 3.6
# State of charge of a heating run; owners do not give it, and it hardly matters.
RUN_SOC = 0.5


@dataclass(frozen=True)
class ComputedWarmth:
    """
    A published battery temperature [deg C] and its computed counterpart, from a common start [deg C].

    `minutes` are those of a heating run or, computed, of a session between two states of charge, `start_soc` and
    `end_soc` (0 ... 1; NaN for a heating run); `end_power_kw` is the computed charging power at its end.
    `not_comparable` says why the computed rise cannot be compared with the published one, or is None.
    """

    car: str
    start_c: float
    published_c: float
    computed_c: float
    minutes: float
    source: str
    start_soc: float | None = None
    end_soc: float | None = None
    end_power_kw: float | None = None
    not_comparable: str | None = None

    @property
    def deviation(self) -> float:
        """Computed over published rise, less 1."""
        return (self.computed_c - self.start_c) / (self.published_c - self.start_c) - 1.0

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as JSON-compatible data."""
        return {**asdict(self), 'deviation': self.deviation}


def computed_warmth(path: Path = FIGURES) -> tuple[list[ComputedWarmth], list[ComputedWarmth]]:
    """
    Return the ComputedWarmth of each heating run of a file, and of each session.

    Raises InvalidInput naming file and car.
    """
    contents = load_checked_yaml(path, SCHEMA)
    drive = contents['heating_drive']
    runs, sessions = [], []
    for node in contents['cars']:
        if 'heating_runs' in node or 'sessions' in node:
            with naming(path, node):
                vehicle = described(DataSheet(node['name'], **node['data_sheet']))
                runs += [_run(vehicle, run, drive) for run in node.get('heating_runs', ())]
                sessions += [_session(vehicle, session) for session in node.get('sessions', ())]
    return runs, sessions


def _check_rise(start_c: float, end_c: float) -> None:
    if not start_c < end_c:
        raise InvalidInput(f'from {start_c:g} to {end_c:g} degC must rise')


def _run(vehicle: Vehicle, node: dict[str, FileData], drive: dict[str, FileData]) -> ComputedWarmth:
    """Return the ComputedWarmth of a drive with the whole power of the heater for the battery."""
    start_c, minutes = float(node['from_c']), float(node['minutes'])
    _check_rise(start_c, node['to_c'])
    trip = make_trip(vehicle, make_route({
        'duration_s': [S_PER_MIN] * max(1, round(minutes)), 'speed_mps': [drive['speed_kmh'] * MPS_PER_KMH],
        'propulsion_power_w': [W_PER_KW * drive['power_kw']], 'ambient_temperature_c': [node['air_c']],
        'cabin_heating_power_w': [0.0], 'auxiliary_power_w': [vehicle.defaults.auxiliary_power_w]}, None))
    _, temperature_c = run_forward(trip, make_runge_kutta_4, RUN_SOC, start_c,
                                   np.full(len(trip.route), vehicle.hvch.maximum_power_w))
    return ComputedWarmth(vehicle.name, start_c, float(node['to_c']), float(temperature_c[-1]), minutes,
                          node['source'])


def _session(vehicle: Vehicle, node: dict[str, FileData]) -> ComputedWarmth:
    """Return the ComputedWarmth of a session in which the car does not heat its battery."""
    start_c, start, end = float(node['start_c']), node['from'] / PERCENT, node['to'] / PERCENT
    _check_rise(start_c, node['end_c'])
    if not start < end:
        raise InvalidInput(f'sessions: from {node["from"]:g} to {node["to"]:g} % must rise')
    car = replace(vehicle, charging=replace(session_charging(vehicle), battery_heating=False))
    session = charge(car, ChargingStop(W_PER_KW * node['charger_kw'], end, float(node['air_c']), 0.0,
                                       vehicle.defaults.auxiliary_power_w), BatteryState(start_c, start))
    return ComputedWarmth(
        vehicle.name, start_c, float(node['end_c']), float(session.battery_temperature_c[-1]),
        session.charging_time_s / S_PER_MIN, node['source'], start, end,
        float(session.charging_power_w[-1]) / W_PER_KW, node.get('not_comparable'))
