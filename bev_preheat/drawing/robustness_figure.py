# SPDX-License-Identifier: Apache-2.0
"""The planner in closed loop with many cars, and one such trip over time."""

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
import numpy as np

from bev_preheat.drawing.figure import legend_above, save_figure, stacked_figure
from bev_preheat.robustness.summary import (
    energy_excess, LEAST_ARRIVAL_ERROR_K, MOST_ARRIVAL_ERROR_K, MOST_EXCESS, MOST_SWITCH_ONS)

COLOURS = {'replanned_paper': 'tab:orange', 'planner': 'tab:blue'}
BINS = 40


def draw_robustness(path, results, methods):
    """Draw arrival errors, energy above the informed drive and switch-ons of TripResults."""
    figure = Figure(figsize=(12.0, 4.2), layout='constrained')
    arrival, energy, switching = figure.subplots(1, 3)
    figure.suptitle(
        f'Cars that differ from their description, {len(results)} trips in closed loop')
    errors_k, excess, switch_ons = ({
        method: np.array([figure_of(result, result.methods[method]) for result in results])
        for method in methods} for figure_of in (
            lambda result, drive: drive.arrival_error_k,
            lambda result, drive: _excess_percent(result.informed, drive),
            lambda result, drive: drive.switch_ons))
    _histograms(arrival, errors_k)
    arrival.axvspan(LEAST_ARRIVAL_ERROR_K, MOST_ARRIVAL_ERROR_K, color='tab:green', alpha=0.12,
                    label='90 % of trips are to be here')
    arrival.set(xlabel='arrival temperature above target (K)', ylabel='trips')
    _histograms(energy, excess)
    energy.axvline(100.0 * MOST_EXCESS, color='tab:green', linestyle='--',
                   label='bound of the mean')
    for method in methods:
        mean = energy_excess(results, method, 'heating_energy_wh')['mean']
        if mean is not None:
            energy.axvline(100.0 * mean, color=COLOURS[method], linestyle=':',
                           label=f'{method}, mean')
    energy.set(xlabel='heating energy above the informed plan (%)', ylabel='trips')
    share = 100.0 * np.arange(1, len(results) + 1) / len(results)
    for method, values in switch_ons.items():
        ordered = np.sort(values)
        # From no trip with less than the fewest on.
        switching.step([ordered[0], *ordered], [0.0, *share], where='post', label=method,
                       color=COLOURS[method])
    switching.axvline(MOST_SWITCH_ONS, color='tab:green', linestyle='--', label='bound')
    switching.set(xscale='symlog', xlim=(0.0, None), ylim=(0.0, 103.0),
                  xlabel='switch-ons', ylabel='trips with at most so many (%)')
    ticks = [tick for tick in (0, 1, 3, 10, 30, 100, 300, 1000)
             if tick <= 1.5 * max(values.max() for values in switch_ons.values()) or tick <= 3]
    switching.set_xticks(ticks, labels=map(str, ticks))
    switching.minorticks_off()
    for axis in (arrival, energy, switching):
        axis.grid(True, alpha=0.3)
        axis.spines[['top', 'right']].set_visible(False)
        # Below the panels, where it hides no trip.
        axis.legend(loc='upper center', bbox_to_anchor=(0.5, -0.16), frameon=False,
                    fontsize='small')
    save_figure(figure, path)


def _excess_percent(informed, drive):
    """Heating energy above the informed drive's [%]; NaN where that did not heat."""
    if informed.heating_energy_wh <= 0.0:
        return np.nan
    return 100.0 * (drive.heating_energy_wh / informed.heating_energy_wh - 1.0)


def _histograms(axis, values):
    everything = np.concatenate(list(values.values()))
    everything = everything[np.isfinite(everything)]
    if len(everything):
        edges = np.histogram_bin_edges(everything, BINS)
        for method, own in values.items():
            axis.hist(own[np.isfinite(own)], edges, alpha=0.6, label=method,
                      color=COLOURS[method])
    axis.yaxis.set_major_locator(MaxNLocator(integer=True))


def draw_trip_course(path, result, courses, target_c):
    """Draw one trip over time, by Courses: temperatures, prediction and command of each method."""
    mismatch = result.mismatch
    figure, axes = stacked_figure(
        2 + len(courses), f'Trip {result.number}: heat capacity × {mismatch.heat_capacity:.2f}, '
        f'leakage × {mismatch.leakage:.2f}, resistance × {mismatch.resistance:.2f}, '
        f'heater × {mismatch.heater:.2f}, propulsion × {mismatch.propulsion_power:.2f}')
    for axis, (method, course) in zip(axes, courses.items()):
        minutes = course.time_s / 60.0
        axis.plot(minutes, course.measured_c, '.', markersize=2.5, color='tab:gray',
                  label='measured')
        axis.plot(minutes, course.true_c, color='black', label='true')
        if np.isfinite(course.estimated_c).any():
            axis.plot(minutes, course.estimated_c, '--', color='tab:red', label='estimated')
        axis.axhline(target_c, color='tab:green', linestyle=':', label='target')
        axis.set_ylabel(f'{method}\nbattery [°C]')
        legend_above(axis)
    predicted, command = axes[-2:]
    for number, (method, course) in enumerate(courses.items()):
        minutes = course.time_s / 60.0
        predicted.plot(minutes, course.predicted_arrival_c, color=COLOURS[method], label=method)
        predicted.plot(minutes[-1], target_c + result.methods[method].arrival_error_k, 'o',
                       color=COLOURS[method])
        command.plot(minutes, course.command_w / 1e3, color=COLOURS[method], label=method,
                     drawstyle='steps-post',
                     # Wide below, narrow above, so that none hides another.
                     linewidth=3.0 if number < len(courses) - 1 else 1.2)
    predicted.axhline(target_c, color='tab:green', linestyle=':', label='target')
    predicted.set_ylabel('predicted arrival\n(dot: true) [°C]')
    command.set_ylabel('command\n[kW]')
    command.set_xlabel('trip time [min]')
    for axis in (predicted, command):
        legend_above(axis)
    save_figure(figure, path)
