# SPDX-License-Identifier: Apache-2.0
"""Cost of each charger, divided into energy, charging, detour and waiting."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.drawing.figure import grid_figure, legend_above, literal, save_figure
from bev_preheat.drawing.palette import BLUE, GRAY, GREEN, ORANGE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from bev_preheat.charging.chargers import CandidateWorth
    from bev_preheat.files.output_files import AnyPath

PARTS = (('energy', 'energy_cost', BLUE), ('charging time', 'charging_cost', ORANGE),
         ('detour', 'detour_cost', GREEN), ('expected wait', 'wait_cost', GRAY))


def draw_chargers(path: AnyPath, ranked: Sequence[CandidateWorth], title: str) -> None:
    """Draw ranked chargers into a file; its suffix gives the format."""
    save_figure(make_chargers_figure(ranked, title), path)


def make_chargers_figure(ranked: Sequence[CandidateWorth], title: str) -> Figure:
    """Return the figure of ranked chargers, the cheapest on top; one with a problem shows its name only."""
    figure, ((axis,),) = grid_figure(1, 1, title, height_in=1.8 + 0.5 * len(ranked))
    places = np.arange(len(ranked))
    left = np.zeros(len(ranked))
    for label, name, colour in PARTS:
        widths = np.array([0.0 if item.problem is not None else getattr(item, name) for item in ranked])
        axis.barh(places, widths, left=left, height=0.6, color=colour, label=label)
        left += widths
    for place, item, end in zip(places, ranked, left):
        text = f' {item.total_cost:.2f}' if item.problem is None else ' not compared'
        axis.annotate(text, (end, place), va='center')
    axis.set_yticks(places, [literal(item.candidate.name) for item in ranked])
    axis.set_axisbelow(True)
    axis.invert_yaxis()
    axis.set_xlim(0.0, max(1.12 * float(left.max(initial=0.0)), 1e-3))
    axis.set(xlabel='cost of energy and time')
    legend_above(axis, columns=4)
    return figure
