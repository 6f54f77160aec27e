# SPDX-License-Identifier: Apache-2.0
"""Makes and saves figures without a screen; curves over time, and their axes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import io
import os
import textwrap
from typing import Any, TYPE_CHECKING
import warnings

import numpy as np

from bev_preheat.files.output_files import AnyPath, write_whole

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Figure  # noqa: PLC0414  for the annotations of other rooms
    from matplotlib.lines import Line2D
    from numpy.typing import ArrayLike, NDArray

    from bev_preheat.numerics import BoolArray, FloatArray

    # Axes in rows and columns; NumPy does not know the type of objects in an array.
    AxesGrid = NDArray[np.object_]

WIDTH_IN = 9.0
# Characters per line of a title, lines of a title, and characters per row of a legend.
TITLE_CHARACTERS = 100
LINES_OF_TITLE = 9
LEGEND_CHARACTERS = 128
# Width of the line sample beside a text, in characters.
HANDLE_CHARACTERS = 8
# More points than this exceed the columns of a picture.
MOST_POINTS = 4000
# Longest trip [s] drawn in a unit, seconds per unit, its name.
TIME_UNITS = ((180.0, 1.0, 's'), (4.0 * 3600.0, 60.0, 'min'), (np.inf, 3600.0, 'h'))
MARGIN = 0.06
# A bound is shown if its distance from the curves is at most this many of their spans.
REACH = 0.6


def grid_figure(rows: int, columns: int, title: str, height_in: float,
                **options: Any) -> tuple[Figure, AxesGrid]:
    """Return (figure, array of axes): panels in `rows` and `columns` under a title."""
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine
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
    """Return a text for matplotlib: long lines wrapped, no formulas, control characters escaped."""
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

    It has as many columns as fit if `columns` is None. There may be another legend on the other side.
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


def picture_of(figure: Figure, form: str, **options: Any) -> bytes:
    """Return the picture of a figure in a format of matplotlib."""
    drawn = io.BytesIO()
    with warnings.catch_warnings():
        # A character missing in the font is drawn as a box.
        warnings.filterwarnings('ignore', message='Glyph .* missing from')
        figure.savefig(drawn, format=form, **options)
    return drawn.getvalue()


def save_figure(figure: Figure, path: AnyPath) -> None:
    """Write a figure; the path's suffix (PICTURE_SUFFIXES) gives the format."""
    write_whole(path, picture_of(figure, os.path.splitext(path)[1].removeprefix('.').lower(), dpi=130))


class TimeAxis:
    """The time of a trip, in a unit that fits its length; call it with seconds to convert them."""

    def __init__(self, duration_s: float) -> None:
        """Choose the unit for a trip of `duration_s` seconds."""
        self.seconds, self.unit = next(
            (seconds, unit) for longest_s, seconds, unit in TIME_UNITS if duration_s <= longest_s)

    def __call__(self, seconds: ArrayLike) -> FloatArray:
        """Return instants [s] in the unit."""
        return np.asarray(seconds, dtype=float) / self.seconds

    def finish(self, axis: Axes, start_s: float, end_s: float, name: str = 'trip time') -> None:
        """Label the x axis, and let it span the trip."""
        axis.set_xlabel(f'{name} [{self.unit}]')
        axis.set_xlim(start_s / self.seconds, end_s / self.seconds)


def draw_course(axis: Axes, instants: ArrayLike, values: ArrayLike, **style: Any) -> Line2D:
    """Draw a curve through values at instants, thinned if there are too many; returns it."""
    kept = _kept(np.asarray(values))
    line, = axis.plot(np.asarray(instants)[kept], np.asarray(values)[kept], **style)
    return line


def draw_steps(axis: Axes, edges: FloatArray, values: ArrayLike, **style: Any) -> Line2D:
    """Draw one value per step, between its edges, as a staircase; returns it."""
    return draw_course(axis, *_staircase(edges, values), **style)


def shade_steps(axis: Axes, edges: FloatArray, low: ArrayLike, high: ArrayLike,
                **style: Any) -> None:
    """Shade the area between two values per step."""
    edges, low = _staircase(edges, np.broadcast_to(low, len(edges) - 1))
    high = np.repeat(np.broadcast_to(high, len(low) // 2), 2)
    kept = _kept(low) | _kept(high)
    axis.fill_between(edges[kept], low[kept], high[kept], linewidth=0.0, **style)


def _staircase(edges: FloatArray, values: ArrayLike) -> tuple[FloatArray, FloatArray]:
    return np.repeat(edges, 2)[1:-1], np.repeat(values, 2)


def _kept(values: FloatArray) -> BoolArray:
    """Return which points of a curve are drawn, shape (N,): the extremes of each column if there are many."""
    kept = np.ones(len(values), dtype=bool)
    if len(values) > MOST_POINTS:
        kept[1:-1] = False
        for part in np.array_split(np.arange(len(values)), MOST_POINTS // 2):
            # A gap (NaN) stays a gap.
            kept[part[[np.argmin(values[part]), np.argmax(values[part])]]] = True
    return kept


def show_range(axis: Axes, *values: ArrayLike, least: float,
               bounds: Iterable[ArrayLike] = ()) -> list[bool]:
    """
    Show all finite values, with a margin, in a span of at least `least`, so that noise is not magnified.

    A bound (value or array) near the curves is shown, too. Returns for each bound whether part of it is in the
    panel.
    """
    low, high = _extent(values)
    # Quantities that start at 0, such as a power, need no space below it.
    missing, below = max(0.0, least - (high - low)), 0.5 if low else 0.0
    low, high = low - below * missing, high + (1.0 - below) * missing
    reach = REACH * (high - low)
    nearest = low - reach, high + reach
    shown = []
    for bound in bounds:
        least_bound, most_bound = _extent([bound])
        shown.append(least_bound <= nearest[1] and most_bound >= nearest[0])
        if shown[-1]:
            low = min(low, max(least_bound, nearest[0]))
            high = max(high, min(most_bound, nearest[1]))
    margin = MARGIN * (high - low)
    axis.set_ylim(low - margin, high + margin)
    return shown


def show_levels(axis: Axes, *values: ArrayLike, least: float, levels: Sequence[Line2D]) -> None:
    """Show values, and horizontal lines as bounds, as `show_range` does; a label says that its line is beyond."""
    heights = [line.get_ydata() for line in levels]
    for line, height, is_shown in zip(levels, heights, show_range(axis, *values, least=least, bounds=heights)):
        if not is_shown:
            side = 'above' if _extent([height])[0] > axis.get_ylim()[1] else 'below'
            line.set_label(f'{line.get_label()} ({side} this range)')


def finish_panel(axis: Axes, label: str, *values: ArrayLike, least: float, levels: Sequence[Line2D] = ()) -> None:
    """Show values and horizontal lines as `show_levels` does, label the y axis, and put the legend above."""
    show_levels(axis, *values, least=least, levels=levels)
    axis.set_ylabel(label)
    legend_above(axis)


def drawn(axis: Axes) -> list[ArrayLike]:
    """Return the values of all lines on an axis."""
    return [line.get_ydata() for line in axis.get_lines()]


def _extent(values: Iterable[ArrayLike]) -> tuple[float, float]:
    finite = np.concatenate([np.ravel(part) for part in values])
    finite = finite[np.isfinite(finite)]
    return (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
