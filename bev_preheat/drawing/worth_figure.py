# SPDX-License-Identifier: Apache-2.0
"""Value of heating: cost over the target, minutes at the charger over energy bought, cost of each charger."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.drawing.figure import grid_figure, legend_above, literal, show_range
from bev_preheat.drawing.palette import BLACK, BLUE, GRAY, GREEN, look_of, ORANGE, WITHOUT_PREHEATING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bev_preheat.charging.chargers import CandidateWorth
    from bev_preheat.charging.target_worth import TargetWorth
    from bev_preheat.charging.worth import Worth

    # Coordinates of a target on the axes: x, y.
    Place = Callable[[TargetWorth], tuple[float, float]]

MARK_POINTS = 9.0
PARTS = (('energy', 'energy_cost', BLUE), ('charging time', 'charging_cost', ORANGE),
         ('detour', 'detour_cost', GREEN), ('expected wait', 'wait_cost', GRAY))


def make_worth_figure(worth: Worth, title: str) -> Figure:
    """Return the figure of a Worth; targets whose session never ends are omitted."""
    figure, ((cost, minutes),) = grid_figure(1, 2, title, height_in=4.8)
    draw_costs(cost, worth)
    _draw(minutes, worth, lambda target: (
        target.bought_energy_wh / 1000.0, target.charging_time_s / 60.0))
    minutes.set(xlabel='energy bought [kWh]', ylabel='time at the charger [min]')
    legend_above(cost, columns=3)
    return figure


def draw_costs(axis: Axes, worth: Worth) -> None:
    """Draw the cost over the target on an axis of any figure."""
    _draw(axis, worth, lambda target: (target.target_c, target.cost))
    axis.set(xlabel='target [°C]', ylabel='cost of energy and time at the charger')


def _draw(axis: Axes, worth: Worth, place: Place) -> None:
    """Draw the curve of all targets, and mark no heating, the fixed target and the best one."""
    points = np.array([place(target) for target in worth.targets])
    finite = points[np.isfinite(points).all(axis=1)]
    axis.plot(finite[:, 0], finite[:, 1], color=GRAY, linewidth=1.6)
    look = look_of(WITHOUT_PREHEATING)
    for target, name, colour, marker, size in (
            (worth.without_heating, 'no heating', look.colour, look.marker, 1.2 * MARK_POINTS),
            (worth.fixed, f'fixed, {worth.fixed.target_c:g} °C', ORANGE, 's', MARK_POINTS),
            (worth.best, 'best' if worth.best is worth.without_heating else
             f'best, {worth.best.target_c:.1f} °C', BLUE, 'o', 0.7 * MARK_POINTS)):
        at = place(target)
        if np.isfinite(at).all():
            axis.plot(*at, linestyle='', marker=marker, color=colour, markersize=size,
                      markeredgecolor=BLACK, markeredgewidth=0.6, label=name)
    show_range(axis, finite[:, 1], least=1e-3)


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
