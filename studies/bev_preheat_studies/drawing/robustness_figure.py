# SPDX-License-Identifier: Apache-2.0
"""Figures of the planner in closed loop: many cars, and a single trip over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.colors import to_rgba
from matplotlib.ticker import MaxNLocator
import numpy as np

from bev_preheat.drawing.curves import draw_course, draw_steps, show_range, TimeAxis
from bev_preheat.drawing.figure import grid_figure, legend_above, save_figure, stacked_figure
from bev_preheat.drawing.palette import look_of, name_of, PREDICTION, TARGET, WANTED
from bev_preheat_studies.robustness.car_figures import (
    energy_excess,
    LEAST_ARRIVAL_ERROR_K,
    MOST_ARRIVAL_ERROR_K,
    MOST_EXCESS,
    MOST_SWITCH_ONS,
    reaches_the_same,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat_studies.robustness.car_study import CarResult
    from bev_preheat_studies.robustness.drives import DriveOutcome, DriveTrace

# Bins of a histogram for each cube root of the number of trips.
BINS_PER_ROOT = 2.2
# Most bins of whole switch-ons.
MOST_BINS = 40


def draw_robustness(path: AnyPath, results: Sequence[CarResult],
                    methods: Sequence[str]) -> None:
    """Draw CarResults into a file, whose suffix selects the format."""
    save_figure(make_robustness_figure(results, methods), path)


def draw_trip_course(path: AnyPath, result: CarResult, courses: Mapping[str, DriveTrace],
                     target_c: float) -> None:
    """Draw a single trip over time into a file, whose suffix selects the format."""
    save_figure(make_trip_figure(result, courses, target_c), path)


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


def make_trip_figure(result: CarResult, courses: Mapping[str, DriveTrace],
                     target_c: float) -> Figure:
    """Return the figure of a single trip from its DriveTraces: temperatures, prediction and command."""
    mismatch = result.mismatch
    figure, axes = stacked_figure(
        2 + len(courses), f'trip {result.number}: heat capacity × {mismatch.heat_capacity:.2f}, '
        f'leakage × {mismatch.leakage:.2f}, resistance × {mismatch.resistance:.2f}, '
        f'heater × {mismatch.heater:.2f}, propulsion × {mismatch.propulsion_power:.2f}')
    predicted, command = axes[-2:]
    # The last command lasts as long as the others.
    ends_s = {method: course.time_s[-1] + (course.time_s[-1] - course.time_s[0])
              / max(len(course.time_s) - 1, 1) for method, course in courses.items()}
    end_s = max(ends_s.values())
    time = TimeAxis(end_s)
    target = {**TARGET, 'label': f'target {target_c:.1f} °C'}
    for axis, (method, course) in zip(axes, courses.items()):
        look, instants = look_of(method), time(course.time_s)
        error_k = result.methods[method].arrival_error_k
        draw_course(axis, instants, course.measured_c, linestyle='', marker='.', markersize=2.5,
                    color=WANTED, label='measured')
        draw_course(axis, instants, course.true_c, **look.line(
            linestyle='-', label=f'true, {target_c + error_k:.1f} °C on arrival'))
        if np.isfinite(course.estimated_c).any():
            draw_course(axis, instants, course.estimated_c, linestyle='--', color=PREDICTION,
                        label='estimated')
        axis.axhline(target_c, **target)
        show_range(axis, course.measured_c, course.true_c, [target_c], least=5.0)
        axis.set_ylabel(f'{method}:\nbattery [°C]')
        draw_course(predicted, instants, course.predicted_arrival_c, **look.line(label=method))
        predicted.plot(time(ends_s[method]), target_c + error_k, color=look.colour, marker='o',
                       linestyle='', clip_on=False, zorder=5.0)
        draw_steps(command, np.append(instants, time(ends_s[method])), course.command_w / 1e3,
                   **look.line(label=method))
    predicted.axhline(target_c, **target)
    show_range(predicted, *(line.get_ydata() for line in predicted.get_lines()), least=2.0)
    predicted.set_ylabel('predicted arrival\n(dot: true) [°C]')
    show_range(command, [0.0], *(line.get_ydata() for line in command.get_lines()), least=1.0)
    command.set_ylabel('command\n[kW]')
    time.finish(command, 0.0, end_s)
    for axis in axes:
        legend_above(axis)
    figure.align_ylabels()
    return figure
