# SPDX-License-Identifier: Apache-2.0
"""Figure of a soak test: memory, time between commands, commanded power."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.drawing.curves import draw_course, show_range, TimeAxis
from bev_preheat.drawing.figure import save_figure, stacked_figure
from bev_preheat.drawing.palette import look_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from bev_preheat.files.output_files import AnyPath

    # (instant [s], power [W], age of the latest state [s]), (instant [s], memory [MB]).
    Commands = Sequence[tuple[float, float, float]]
    Samples = Sequence[tuple[float, float]]


def draw_endurance(path: AnyPath, commands: Commands, memory_samples: Samples) -> None:
    """Draw a soak test into a file, whose suffix selects the format."""
    save_figure(make_endurance_figure(commands, memory_samples), path)


def make_endurance_figure(commands: Commands, memory_samples: Samples) -> Figure:
    """
    Return the figure of a soak test over its time.

    `commands` are (instant [s], power [W], …), `memory_samples` (instant [s], memory [MB]).
    """
    figure, (memory, intervals, power) = stacked_figure(3, 'The planner under load')
    samples = np.array(memory_samples, dtype=float).reshape(-1, 2)
    instants_s, powers_w = np.array(
        [command[:2] for command in commands], dtype=float).reshape(-1, 2).T
    elapsed_s = instants_s - instants_s[:1]
    duration_s = max([1.0, *samples[:, 0], *elapsed_s[-1:]])
    time, line = TimeAxis(duration_s), look_of('planner').line(linewidth=1.2)
    draw_course(memory, time(samples[:, 0]), samples[:, 1], **line)
    show_range(memory, samples[:, 1], least=10.0)
    memory.set_ylabel('resident memory\n[MB]')
    # With tens of thousands of commands, only the longest gap in each second is visible.
    second = elapsed_s.astype(int)
    seconds = np.arange(second[-1] + 1 if len(second) else 0)
    longest_s, sum_w = np.zeros(len(seconds)), np.zeros(len(seconds))
    np.maximum.at(longest_s, second[1:], np.diff(elapsed_s))
    np.add.at(sum_w, second, powers_w)
    mean_w = sum_w / np.maximum(np.bincount(second, minlength=len(seconds)), 1)
    draw_course(intervals, time(seconds), 1e3 * longest_s, **line)
    show_range(intervals, [0.0], 1e3 * longest_s, least=10.0)
    intervals.set_ylabel('longest time between\ncommands in a second\n[ms]')
    draw_course(power, time(seconds), 1e-3 * mean_w, **line)
    show_range(power, [0.0], 1e-3 * mean_w, least=1.0)
    power.set_ylabel('mean command\n[kW]')
    time.finish(power, 0.0, duration_s)
    power.set_xlabel(f'time [{time.unit}]')
    figure.align_ylabels()
    return figure
