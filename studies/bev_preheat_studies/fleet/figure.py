# SPDX-License-Identifier: Apache-2.0
"""Figure of a fleet: minutes saved and energy bought, by air temperature and by trip length."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.drawing.figure import grid_figure, legend_above
from bev_preheat.drawing.palette import GRAY, look_of
from bev_preheat_studies.fleet.winter_trips import ALWAYS, AMBIENTS, BEST, LENGTHS, USUAL

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bev_preheat_studies.fleet.study import Figures

# The ways drawn as lines, widest first; the spread is shown for the last.
DRAWN = {BEST: ("the planner's choice of target", look_of('value_function')),
         USUAL: ("the car's usual target", look_of('paper')), ALWAYS: ('heater always on', look_of('always_on'))}
SPREAD_OF = BEST
SPREAD_ALPHA = 0.12
# Distance between the ways' markers, as a share of that between groups.
BESIDE = 0.1


def make_fleet_figure(summary: Figures) -> Figure:
    """Return the figure of a fleet's summary (`summarise_fleet`)."""
    trips = f'{summary["trips"]:,}'.replace(',', ' ')
    figure, axes = grid_figure(
        2, 2, f'Preheating compared with no preheating: {trips} winter trips to a fast charger', height_in=6.6,
        sharey='row')
    for row, (name, label) in enumerate((('saved_min', 'time saved at the charger [min]'),
                                         ('more_kwh', 'additional energy bought [kWh]'))):
        for column, (groups, heading) in enumerate(((AMBIENTS, 'air temperature [°C]'),
                                                    (LENGTHS, 'driving time to the charger [min]'))):
            axis = axes[row, column]
            _draw(axis, summary, name, [group for group, _, _ in groups if group in summary['groups']])
            axis.set_ylabel(label if column == 0 else '')
            axis.set_xlabel(heading if row == 1 else '')
    lines, bands = axes[0, 0].get_lines(), axes[0, 1].collections
    labels = [label for label, _ in DRAWN.values()]
    legend_above(axes[0, 0], [line for line in lines if line.get_label() in labels],
                 title='mean of the trips', columns=1)
    legend_above(axes[0, 1], list(bands), columns=1)
    return figure


def _draw(axis: Axes, summary: Figures, name: str, groups: list[str]) -> None:
    """Draw each way's mean over the groups, and the 5 ... 95 % range of SPREAD_OF."""
    places = range(len(groups))

    def values(way: str, figure: str) -> list[float]:
        return [summary['groups'][group]['ways'][way][name][figure] for group in groups]

    axis.axhline(0.0, color=GRAY, linewidth=0.6)
    axis.fill_between(places, values(SPREAD_OF, '5 %'), values(SPREAD_OF, '95 %'), linewidth=0.0,
                      color=DRAWN[SPREAD_OF][1].colour, alpha=SPREAD_ALPHA,
                      label=f'{DRAWN[SPREAD_OF][0]}: 5 to 95 % of the trips')
    for index, (way, (label, look)) in enumerate(DRAWN.items()):
        # Beside each other, because ways that save as much would hide one another.
        beside = [place + BESIDE * (index - 1) for place in places]
        axis.plot(beside, values(way, 'mean'),
                  **look.line(label=label, marker=look.marker, markersize=5.0, markerfacecolor='none'))
    axis.set_xticks(list(places), [_tick(group) for group in groups], fontsize='small')


def _tick(group: str) -> str:
    """Return a short tick label: the name of a group without its unit."""
    name = group.rpartition(' ')[0].replace('-', '−')
    return name.replace('below', '<').replace('from', '≥').replace(' to ', '…')
