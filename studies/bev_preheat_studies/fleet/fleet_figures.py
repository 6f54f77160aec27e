# SPDX-License-Identifier: Apache-2.0
"""Summarise a fleet's Tally: the figures for JSON and tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.numerics.factors import S_PER_MIN, WH_PER_KWH
from bev_preheat_studies.fleet import drawn_fleet
from bev_preheat_studies.fleet.tally import (
    ALL,
    AMBIENTS,
    ARRIVAL_C,
    BIN_WIDTHS,
    BOUGHT_WH,
    CHARGING_S,
    HEATER_WH,
    LENGTHS,
    MORE_WH,
    REACHED,
    SAVED_S,
)
from bev_preheat_studies.fleet.ways import NONE, WAYS

if TYPE_CHECKING:
    from typing import Any

    from bev_preheat_studies.fleet.tally import Tally

    # Plain values, as in JSON.
    Figures = dict[str, Any]

# Name of a figure: (quantity, how many of its units make one of the figure's).
MEANS = {'heater_kwh': (HEATER_WH, WH_PER_KWH), 'bought_kwh': (BOUGHT_WH, WH_PER_KWH),
         'charging_min': (CHARGING_S, S_PER_MIN), 'arrival_c': (ARRIVAL_C, 1.0), 'reached': (REACHED, 1.0)}
DISTRIBUTIONS = {'saved_min': (SAVED_S, S_PER_MIN), 'more_kwh': (MORE_WH, WH_PER_KWH)}
# Constants of `drawn_fleet` without a source or a meaning of their own.
NOT_DRAWN = ('MPS_PER_KMH', 'S_PER_MIN', 'S_PER_H')
QUANTILES = {'5 %': 0.05, 'median': 0.5, '95 %': 0.95}


def summarise_fleet(tally: Tally) -> Figures:
    """
    Return the figures of a fleet: {group: {'trips', 'ways': {way: {figure: value}}}}.

    `saved_min` and `more_kwh` are relative to the same trip without heating: minutes at the charger, and
    energy bought for the same departure. Each has a mean and quantiles (from the histograms' bins); a group
    of one temperature and one length has only a mean.
    """
    groups = [ALL, *drawn_fleet.CARS, *AMBIENTS, *LENGTHS, *(
        f'{ambient}, {length}' for ambient in AMBIENTS for length in LENGTHS)]
    return {'trips': tally.trips[ALL], 'left_out': dict(tally.left_out),
            'groups': {group: {'trips': tally.trips[group],
                               'ways': {way: _figures(tally, way, group) for way in WAYS}}
                       for group in groups}}


def _figures(tally: Tally, way: str, group: str) -> Figures:
    figures: Figures = {name: _in_units(tally.mean(way, group, quantity), unit)
                        for name, (quantity, unit) in MEANS.items()}
    for name, (quantity, unit) in DISTRIBUTIONS.items():
        figures[name] = {'mean': _in_units(tally.mean(way, group, quantity), unit)}
        if way != NONE and (way, group, quantity) in tally.bins:
            figures[name] |= {share: _in_units(tally.quantile(way, group, quantity, at), unit)
                              for share, at in QUANTILES.items()}
    return figures


def _in_units(value: float | None, unit: float) -> float | None:
    return None if value is None else value / unit


def drawn() -> Figures:
    """Return the study's distributions: constants of `drawn_fleet`, and bin widths."""
    constants = {name.lower(): value for name, value in vars(drawn_fleet).items()
                 if name.isupper() and isinstance(value, (float, dict, tuple)) and name not in NOT_DRAWN}
    plain = {name: {str(key): share for key, share in value.items()} if isinstance(value, dict)
             else list(value) if isinstance(value, tuple) else value for name, value in constants.items()}
    return {**plain, 'bin_widths': dict(BIN_WIDTHS)}
