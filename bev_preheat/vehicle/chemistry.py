# SPDX-License-Identifier: Apache-2.0
"""Typical cell data by chemistry; figures and sources are in chemistry.yaml."""

from __future__ import annotations

from dataclasses import dataclass, is_dataclass
from functools import cache
from pathlib import Path
from typing import get_type_hints, TYPE_CHECKING

import yaml

if TYPE_CHECKING:
    from bev_preheat.files.checked_yaml import FileData

CHEMISTRIES = ('nmc', 'lfp')
FIGURES = Path(__file__).with_name('chemistry.yaml')


@dataclass(frozen=True)
class Shares:
    """Power as a share of the maximum: the product of a share over state of charge and one over temperature."""

    soc: tuple[float, ...]
    soc_share: tuple[float, ...]
    temperature_c: tuple[float, ...]
    temperature_share: tuple[float, ...]
    source: str


@dataclass(frozen=True)
class HotShare:
    """Share of its charging power that a hot battery takes, over its temperature [deg C]; 1 below the first."""

    temperature_c: tuple[float, ...]
    share: tuple[float, ...]
    source: str


@dataclass(frozen=True)
class Polarization:
    """Resistance of a pack after minutes of steady current, over that of pulses of seconds."""

    factor: float
    source: str


@dataclass(frozen=True)
class ChargingShape:
    """
    Charging power of a class of cars over the state of charge, as a share of its maximum.

    `peak_rate_per_h` is the maximum over the gross energy [1/h], `temperature_c` the battery temperature
    [deg C] of the published curve.
    """

    soc: tuple[float, ...]
    share: tuple[float, ...]
    peak_rate_per_h: float
    temperature_c: float
    source: str


@dataclass(frozen=True)
class CellVoltage:
    """Open-circuit voltage of a cell [V] over its state of charge."""

    soc: tuple[float, ...]
    voltage_v: tuple[float, ...]
    source: str


@dataclass(frozen=True)
class CellResistance:
    """Resistance of a cell times its capacity [ohm Ah] at 25 degC and half charge, and factors that scale it."""

    specific_resistance_ohm_ah: float
    source: str
    temperature_c: tuple[float, ...]
    temperature_factor: tuple[float, ...]
    temperature_source: str
    soc: tuple[float, ...]
    soc_factor: tuple[float, ...]
    soc_source: str


@dataclass(frozen=True)
class Chemistry:
    """Figures of chemistry.yaml, with their units in the names."""

    nominal_cell_voltage_v: float
    nominal_cell_voltage_range_v: tuple[float, float]
    energy_density_wh_per_kg: float
    energy_density_range_wh_per_kg: tuple[float, float]
    energy_density_source: str
    usable_share: float
    usable_share_source: str
    cell_heat_capacity_j_per_kg_k: float
    cell_heat_capacity_source: str
    open_circuit_voltage: CellVoltage
    resistance: CellResistance
    charge_share: Shares
    discharge_share: Shares
    hot_share: HotShare
    polarization_400_v: Polarization
    polarization_800_v: Polarization
    charging_shape_400_v: ChargingShape
    charging_shape_800_v: ChargingShape


@cache
def load_chemistry(name: str) -> Chemistry:
    """Return the Chemistry of one of CHEMISTRIES."""
    figures = dict(yaml.safe_load(FIGURES.read_text(encoding='utf-8'))[name])
    for key, kind in get_type_hints(Chemistry).items():
        if isinstance(kind, type) and is_dataclass(kind):
            figures[key] = kind(**_frozen(figures[key]))
    return Chemistry(**_frozen(figures))


def _frozen(figures: dict[str, FileData]) -> dict[str, FileData]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in figures.items()}
