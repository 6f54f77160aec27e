# SPDX-License-Identifier: Apache-2.0
"""A soak test as a picture: memory, time between commands, commanded power."""

import numpy as np

from bev_preheat.drawing.figure import save_figure, stacked_figure


def draw_endurance(path, commands, memory_samples):
    """
    Draw a soak test over its minutes; the suffix of the path says as what.

    `commands` are (instant [s], power [W], …), `memory_samples` (instant [s], memory [MB]).
    """
    figure, (memory, intervals, power) = stacked_figure(3, 'The planner under load')
    instants_s, memory_mb = np.array(memory_samples).T
    memory.plot(instants_s / 60.0, memory_mb)
    low, high = memory_mb.min(), memory_mb.max()
    memory.set(ylabel='memory (MB)', ylim=(low - 5.0, high + 5.0))
    rows = np.array([(instant_s, power_w) for instant_s, power_w, *_ in commands])
    minutes = (rows[:, 0] - rows[0, 0]) / 60.0
    # Of ten thousands of points only the longest in each second are seen anyhow.
    gaps_s, second = np.diff(rows[:, 0]), (60.0 * minutes[1:]).astype(int)
    longest_s = np.zeros(second[-1] + 1)
    np.maximum.at(longest_s, second, gaps_s)
    intervals.plot(np.arange(len(longest_s)) / 60.0, 1e3 * longest_s)
    intervals.set(ylabel='longest time between\ncommands in a second (ms)')
    mean_w = (np.bincount((60.0 * minutes).astype(int), weights=rows[:, 1])
              / np.maximum(np.bincount((60.0 * minutes).astype(int)), 1))
    power.plot(np.arange(len(mean_w)) / 60.0, 1e-3 * mean_w)
    power.set(ylabel='mean command (kW)', xlabel='time (min)')
    save_figure(figure, path)
