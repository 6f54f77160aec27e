# SPDX-License-Identifier: Apache-2.0
"""Makes and saves figures without a screen."""

from __future__ import annotations

import io
import os
import textwrap
from typing import TYPE_CHECKING
import warnings

from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from bev_preheat.files.output_files import write_whole

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    import numpy as np
    from numpy.typing import NDArray

    from bev_preheat.files.output_files import AnyPath

    # Axes in rows and columns; NumPy does not know the type of objects in an array.
    AxesGrid = NDArray[np.object_]

WIDTH_IN = 9.0
# Characters per line of a title, lines of a title, and characters per row of a legend.
TITLE_CHARACTERS = 100
LINES_OF_TITLE = 9
LEGEND_CHARACTERS = 128
# Width of the line sample beside a text, in characters.
HANDLE_CHARACTERS = 8


def grid_figure(rows: int, columns: int, title: str, height_in: float,
                **options: Any) -> tuple[Figure, AxesGrid]:
    """Return (figure, array of axes): panels in `rows` and `columns` under a title."""
    figure = Figure(figsize=(WIDTH_IN, height_in),
                    layout=ConstrainedLayoutEngine(h_pad=0.06, w_pad=0.06))
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    figure.suptitle(literal(title), fontsize='medium')
    for axis in axes.flat:
        axis.grid(True, alpha=0.3)
        axis.spines[['top', 'right']].set_visible(False)
        # Tick labels in full, without "+1e3" or "1e6" at the end of the axis.
        axis.ticklabel_format(style='plain', useOffset=False)
    return figure, axes


def stacked_figure(panels: int, title: str,
                   panel_height_in: float = 1.9) -> tuple[Figure, list[Axes]]:
    """Return (figure, list of axes): stacked panels that share the x axis."""
    figure, axes = grid_figure(panels, 1, title, panel_height_in * panels + 0.8, sharex=True)
    return figure, list(axes[:, 0])


def literal(text: str) -> str:
    """
    Return a text of several lines for matplotlib: long lines wrapped, no formulas.

    File names may contain dollar signs and unprintable characters.
    """
    lines = []
    for line in text.encode('utf-8', 'backslashreplace').decode().split('\n'):
        shown = ''.join(character if character.isprintable() else '\N{REPLACEMENT CHARACTER}'
                        for character in line)
        lines += textwrap.wrap(shown, TITLE_CHARACTERS, break_on_hyphens=False)
    if len(lines) > LINES_OF_TITLE:
        lines[LINES_OF_TITLE - 1:] = ['…']
    return '\n'.join(lines).replace('$', r'\$')


def legend_above(axis: Axes, handles: Sequence[Artist] | None = None, title: str | None = None,
                 side: str = 'left', columns: int | None = None) -> None:
    """
    Put a legend above an axis, so that it covers no curve; `handles` are those of the axis if None.

    It has as many columns as fit if `columns` is None. There may be another legend on
    the other side.
    """
    others = axis.get_legend()
    handles = axis.get_legend_handles_labels()[0] if handles is None else handles
    if not handles:
        return
    widths = [HANDLE_CHARACTERS + len(str(handle.get_label())) for handle in handles]
    if columns is None:
        columns = (len(widths) if sum(widths) <= LEGEND_CHARACTERS
                   else max(1, LEGEND_CHARACTERS // max(widths)))
    axis.legend(
        handles=handles, title=title, alignment='left',
        loc='lower left' if side == 'left' else 'lower right',
        bbox_to_anchor=(0.0 if side == 'left' else 1.0, 1.0), borderaxespad=0.1, borderpad=0.1,
        ncols=columns, fontsize='small', title_fontsize='small',
        frameon=False, handlelength=3.2)
    if others is not None:
        axis.add_artist(others)
        # Clipped artists are ignored by the layout.
        others.set_clip_on(False)


def save_figure(figure: Figure, path: AnyPath) -> None:
    """Write a figure; the path's suffix (PICTURE_SUFFIXES) gives the format."""
    drawn = io.BytesIO()
    with warnings.catch_warnings():
        # A character missing in the font is drawn as a box.
        warnings.filterwarnings('ignore', message='Glyph .* missing from')
        figure.savefig(drawn, format=os.path.splitext(path)[1].removeprefix('.').lower(), dpi=130)
    write_whole(path, drawn.getvalue())
