# SPDX-License-Identifier: Apache-2.0
"""Figure of a sweep: the gap of each method to the optimum, and on which trips it occurs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.drawing.figure import grid_figure, legend_above
from bev_preheat.drawing.palette import GRAY, look_of, name_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from matplotlib.figure import Figure

    from bev_preheat.numerics import FloatArray
    from bev_preheat_studies.optimality.sweep import GapResult

# Gaps below this are the solver's rounding; a logarithmic axis needs a floor.
FLOOR_WH = 1e-6


def make_sweep_figure(results: Sequence[GapResult], methods: Iterable[str]) -> Figure:
    """
    Return the figure of GapResults: the distribution of gaps, and the gap over trip length.

    Energies are compared on the feasible trips on which a plan reaches the same as the program; the legend
    gives the number of the others.
    """
    feasible = [result for result in results if result.is_feasible]
    figure, ((shares, over_length),) = grid_figure(
        1, 2, f'Energy above the optimum (nonlinear program): {len(feasible)} feasible trips', height_in=5.0)
    lines, dots = [], []
    for method in methods:
        reached = [(result.duration_s / 60.0, max(abs(gap_wh), FLOOR_WH)) for result in feasible
                   if (gap_wh := result.methods[method].gap_wh) is not None]
        gaps_wh = np.array([gap_wh for _, gap_wh in reached])
        look, missed = look_of(method), len(feasible) - len(reached)
        lines += shares.step(
            *_distribution(gaps_wh, len(feasible)), where='post', **look.line(
                label=f'{method}, not comparable on {missed}' if missed else name_of(method)))
        dots += over_length.plot([duration_min for duration_min, _ in reached], gaps_wh,
                                 **look.line(linestyle='', marker=look.marker, markersize=3.0 + 1.2 * look.width,
                                             markerfacecolor='none', markeredgewidth=0.9,
                                             label=name_of(method)))
    shares.axhline(100.0, color=GRAY, linewidth=0.6)
    shares.set(xscale='log', ylim=(0.0, 104.0), xlabel='energy above the optimum, magnitude [Wh]',
               ylabel='share of trips with this energy or less [%]')
    over_length.set(yscale='log', xlabel='driving time [min]',
                    ylabel='energy above the optimum, magnitude [Wh]')
    over_length.set_xlim(left=0.0)
    # If all gaps are equal, a logarithmic axis has no range.
    shares.set_xlim(left=0.5 * FLOOR_WH)
    over_length.set_ylim(bottom=0.5 * FLOOR_WH)
    legend_above(shares, lines, columns=1)
    legend_above(over_length, dots, columns=1)
    return figure


def _distribution(values: FloatArray, whole: int) -> tuple[FloatArray, FloatArray]:
    """Return the steps of a cumulative distribution: values, and share of `whole` up to each [%]."""
    ordered = np.sort(values)
    return (np.concatenate((ordered[:1], ordered)),
            100.0 * np.arange(len(ordered) + 1 if len(ordered) else 0) / max(whole, 1))
