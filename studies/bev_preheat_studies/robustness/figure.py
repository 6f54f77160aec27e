# SPDX-License-Identifier: Apache-2.0
"""Figure of the planner in closed loop with many cars."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
import numpy as np

from bev_preheat.drawing.figure import grid_figure
from bev_preheat.drawing.palette import look_of, name_of, WANTED
from bev_preheat.numerics import FloatArray
from bev_preheat_studies.robustness.cars import (
    CarResult,
    energy_excess,
    LEAST_ARRIVAL_ERROR_K,
    MOST_ARRIVAL_ERROR_K,
    MOST_EXCESS,
    MOST_SWITCH_ONS,
    reaches_the_same,
)
from bev_preheat_studies.robustness.driven import DriveOutcome

# Bins of a histogram for each cube root of the number of trips.
BINS_PER_ROOT = 2.2
# Most bins of whole switch-ons.
MOST_BINS = 40


def make_robustness_figure(results: Sequence[CarResult], methods: Sequence[str]) -> Figure:
    """Return the figure of arrival errors, energy above the plan with the true car, and switch-ons."""
    figure, axes = grid_figure(
        2, 2, f'{len(results)} trips with cars that differ from their vehicle file',
        height_in=7.0)
    (arrival, energy), (switching, key) = axes

    def figures(figure_of: Callable[[CarResult, DriveOutcome], float]) -> dict[str, FloatArray]:
        return {method: np.array([figure_of(result, result.methods[method]) for result in results],
                                 dtype=float) for method in methods}

    errors_k = figures(lambda _, drive: drive.arrival_error_k)
    _histograms(arrival, errors_k, _rounded_edges(errors_k, least=1.0))
    arrival.axvspan(LEAST_ARRIVAL_ERROR_K, MOST_ARRIVAL_ERROR_K, color=WANTED, alpha=0.2, zorder=0.5,
                    linewidth=0.0, label='required for 90 % of the trips')
    arrival.set(xlabel='arrival temperature minus target [K]', ylabel='number of trips')

    excess = figures(lambda result, drive: _excess_percent(result.informed, drive))
    _histograms(energy, excess, _rounded_edges(excess, least=2.0))
    energy.axvline(100.0 * MOST_EXCESS, color=WANTED, linestyle='--',
                   label='required maximum (energy: of the mean)')
    for method in methods:
        mean = energy_excess(results, method, 'heating_energy_wh')['mean']
        if mean is not None:
            energy.axvline(100.0 * mean, color=look_of(method).colour, linestyle=':',
                           label=f'{name_of(method)}: mean')
    energy.set(xlabel='additional heating energy [%]', ylabel='number of trips')
    energy.set_title('compared with a plan that knows the true car,\non trips that arrive equally warm',
                     fontsize='medium')

    _draw_switch_ons(switching, figures(lambda _, drive: drive.switch_ons))
    # One legend for all panels, in place of a fourth panel.
    key.set_axis_off()
    handles = {label: handle for axis in (arrival, energy)
               for handle, label in zip(*axis.get_legend_handles_labels())}
    key.legend(handles.values(), handles.keys(), loc='center', frameon=False)
    return figure


def _draw_switch_ons(axis: Axes, switch_ons: Mapping[str, FloatArray]) -> None:
    most = max(MOST_SWITCH_ONS, *(values.max() for values in switch_ons.values()))
    # Whole numbers are in the middle of a bin.
    _histograms(axis, switch_ons, np.arange(-0.5, most + np.ceil((most + 1) / MOST_BINS) + 0.5,
                                            np.ceil((most + 1) / MOST_BINS)))
    axis.axvline(MOST_SWITCH_ONS, color=WANTED, linestyle='--')
    axis.set(xlabel='times the heater was switched on', ylabel='number of trips')
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))


def _excess_percent(informed: DriveOutcome, drive: DriveOutcome) -> float:
    """Return the heating energy above the informed drive's [%]; NaN if they cannot be compared."""
    if informed.heating_energy_wh <= 0.0 or not reaches_the_same(drive, informed):
        return np.nan
    return 100.0 * (drive.heating_energy_wh / informed.heating_energy_wh - 1.0)


def _rounded_edges(values: Mapping[str, FloatArray], least: float) -> FloatArray:
    """Return edges of bins at round numbers, for the number of trips, over at least `least`."""
    everything = np.concatenate(list(values.values()))
    everything = everything[np.isfinite(everything)]
    if not len(everything):
        return np.zeros(0)
    low, high = everything.min(), everything.max()
    trips = max(map(len, values.values()))
    width = max(high - low, least) / (BINS_PER_ROOT * np.cbrt(trips))
    steps = np.array([1.0, 2.0, 5.0, 10.0]) * 10.0**np.floor(np.log10(width))
    step = float(steps[np.abs(np.log(steps / width)).argmin()])
    return step * np.arange(np.floor(low / step), np.floor(high / step) + 2.0)


def _histograms(axis: Axes, values: Mapping[str, FloatArray], edges: FloatArray) -> None:
    """Draw histograms over each other, hatched differently; without edges there is nothing to draw."""
    if len(edges):
        for (method, own), hatch in zip(values.items(), ('///', '')):
            colour = look_of(method).colour
            axis.hist(own[np.isfinite(own)], edges.tolist(), histtype='stepfilled', label=name_of(method),
                      facecolor=to_rgba(colour, 0.4), edgecolor=colour, hatch=hatch)
    axis.yaxis.set_major_locator(MaxNLocator(integer=True))
