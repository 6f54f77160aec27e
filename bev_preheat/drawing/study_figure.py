# SPDX-License-Identifier: Apache-2.0
"""A study as a picture: how far each method is from the optimum, and on which trips."""

from matplotlib.figure import Figure
import numpy as np

from bev_preheat.drawing.figure import save_figure
from bev_preheat.study.run import FEASIBLE

# Gaps below this are the solver's rounding; a logarithmic axis needs a floor.
FLOOR_WH = 1e-6


def draw_study(path, results, methods):
    """Draw the distribution of gaps and the gap over trip length; the suffix says which kind."""
    feasible = [result for result in results if result.outcome == FEASIBLE]
    figure = Figure(figsize=(9.0, 4.2), layout='constrained')
    shares, over_length = figure.subplots(1, 2)
    figure.suptitle(f'More energy than the nonlinear program, {len(feasible)} feasible trips')
    minutes = np.array([result.duration_s / 60.0 for result in feasible])
    for method in methods:
        gaps_wh = np.array([max(abs(result.methods[method].gap_wh), FLOOR_WH)
                            for result in feasible])
        share = np.arange(1, len(gaps_wh) + 1) / len(gaps_wh)
        shares.step(np.sort(gaps_wh), 100.0 * share, where='post', label=method)
        over_length.scatter(minutes, gaps_wh, s=8, label=method)
    shares.set(xscale='log', xlabel='|energy gap| (Wh)', ylabel='trips with at most that gap (%)')
    over_length.set(yscale='log', xlabel='trip length (min)', ylabel='|energy gap| (Wh)')
    for axis in (shares, over_length):
        axis.grid(True, alpha=0.3)
        axis.legend()
    save_figure(figure, path)
