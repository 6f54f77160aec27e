# SPDX-License-Identifier: Apache-2.0
"""Makes and saves figures without a screen."""

import io
import os

import matplotlib
matplotlib.use('Agg')
from matplotlib.figure import Figure  # noqa: E402  the backend must be set first

from bev_preheat.errors import InvalidInput  # noqa: E402
from bev_preheat.output_files import write_whole  # noqa: E402


def stacked_figure(panels, title, width_in=9.0, panel_height_in=1.9):
    """Return (figure, list of axes): panels above each other that share the x axis."""
    figure = Figure(figsize=(width_in, panel_height_in * panels + 0.8), layout='constrained')
    axes = figure.subplots(panels, 1, sharex=True, squeeze=False)[:, 0]
    # Room for the legends above the panels.
    figure.get_layout_engine().set(h_pad=0.14)
    figure.suptitle(title)
    for axis in axes:
        axis.grid(True, alpha=0.3)
        axis.spines[['top', 'right']].set_visible(False)
    return figure, list(axes)


def legend_above(axis, twin=None):
    """Put the legend of an axis, and of its twin, above it, where it covers no line."""
    lines = axis.get_legend_handles_labels()[0]
    if twin is not None:
        lines += twin.get_legend_handles_labels()[0]
    legend = axis.legend(lines, [line.get_label() for line in lines], loc='lower left',
                         bbox_to_anchor=(0.0, 0.96), ncols=6, fontsize='small', frameon=False)
    # Else a long legend would make all panels narrow.
    legend.set_in_layout(False)


def save_figure(figure, path):
    """Write a figure; the suffix of the path, one of PICTURE_SUFFIXES, says as what."""
    drawn = io.BytesIO()
    try:
        figure.savefig(drawn, format=os.path.splitext(path)[1].removeprefix('.').lower(), dpi=130)
    except ValueError as error:
        # A title with dollar signs, for one, that is no formula.
        raise InvalidInput(f'{path}: cannot be drawn: {error}') from error
    write_whole(path, drawn.getvalue())
