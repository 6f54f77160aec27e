# SPDX-License-Identifier: Apache-2.0
"""Figures of the planner in closed loop: many cars, and a single trip over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.colors import to_rgba
from matplotlib.ticker import MaxNLocator
import numpy as np

from bev_preheat.drawing.curves import draw_course, draw_steps, show_range, TimeAxis
from bev_preheat.drawing.figure import grid_figure, legend_above, save_figure, stacked_figure
from bev_preheat.drawing.palette import look_of, PREDICTION, TARGET, WANTED
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

BINS = 40


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
        2, 2, f'Cars that differ from their vehicle file: {len(results)} trips in closed loop',
        height_in=7.0)
    (arrival, energy), (switching, key) = axes

    def figures(figure_of: Callable[[CarResult, DriveOutcome], float]) -> dict[str, FloatArray]:
        return {method: np.array([figure_of(result, result.methods[method]) for result in results],
                                 dtype=float) for method in methods}

    _histograms(arrival, figures(lambda _, drive: drive.arrival_error_k), least=1.0)
    arrival.axvspan(LEAST_ARRIVAL_ERROR_K, MOST_ARRIVAL_ERROR_K, color=WANTED, alpha=0.2, zorder=0.5,
                    linewidth=0.0, label='required: 90 % of the trips within')
    arrival.set(xlabel='arrival temperature above target [K]', ylabel='trips')

    _histograms(energy, figures(lambda result, drive: _excess_percent(result.informed, drive)),
                least=2.0)
    energy.axvline(100.0 * MOST_EXCESS, color=WANTED, linestyle='--',
                   label='required: at most (energy: mean)')
    for method in methods:
        mean = energy_excess(results, method, 'heating_energy_wh')['mean']
        if mean is not None:
            energy.axvline(100.0 * mean, color=look_of(method).colour, linestyle=':',
                           label=f'{method}, mean')
    energy.set(xlabel='heating energy above plan with true car [%]', ylabel='trips')

    _draw_switch_ons(switching, figures(lambda _, drive: drive.switch_ons))
    # One legend for all panels, in place of a fourth panel.
    key.set_axis_off()
    handles = {label: handle for axis in (arrival, energy)
               for handle, label in zip(*axis.get_legend_handles_labels())}
    key.legend(handles.values(), handles.keys(), loc='center', frameon=False)
    return figure


def _draw_switch_ons(axis: Axes, switch_ons: Mapping[str, FloatArray]) -> None:
    most = max(values.max() for values in switch_ons.values())
    for method, values in switch_ons.items():
        ordered = np.sort(values)
        share = 100.0 * np.arange(1, len(ordered) + 1) / len(ordered)
        # Below the fewest switch-ons, the share is 0.
        axis.step([ordered[0], *ordered], [0.0, *share], where='post', **look_of(method).line())
    axis.axvline(MOST_SWITCH_ONS, color=WANTED, linestyle='--')
    axis.set(xscale='symlog', xlim=(0.0, 1.2 * max(most, MOST_SWITCH_ONS)), ylim=(0.0, 104.0),
             xlabel='switch-ons, at most', ylabel='share of trips [%]')
    ticks = [tick for tick in (0, 1, 3, 10, 30, 100, 300, 1000)
             if tick <= max(most, MOST_SWITCH_ONS)]
    axis.set_xticks(ticks, labels=map(str, ticks))
    axis.minorticks_off()


def _excess_percent(informed: DriveOutcome, drive: DriveOutcome) -> float:
    """Return the heating energy above the informed drive's [%]; NaN if they cannot be compared."""
    if informed.heating_energy_wh <= 0.0 or not reaches_the_same(drive, informed):
        return np.nan
    return 100.0 * (drive.heating_energy_wh / informed.heating_energy_wh - 1.0)


def _histograms(axis: Axes, values: Mapping[str, FloatArray], least: float) -> None:
    """Draw overlaid histograms with different hatches, over a range of at least `least`."""
    everything = np.concatenate(list(values.values()))
    everything = everything[np.isfinite(everything)]
    if len(everything):
        low, high = everything.min(), everything.max()
        margin = max(0.0, 0.5 * (least - (high - low)))
        edges = np.histogram_bin_edges(everything, BINS, (low - margin, high + margin))
        for (method, own), hatch in zip(values.items(), ('///', '')):
            colour = look_of(method).colour
            axis.hist(own[np.isfinite(own)], edges.tolist(), histtype='stepfilled', label=method,
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
