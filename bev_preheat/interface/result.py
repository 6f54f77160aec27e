# SPDX-License-Identifier: Apache-2.0
"""The base of all results: one line as text, a picture in a notebook, `plot`."""

from __future__ import annotations

from base64 import b64encode
from html import escape
import io
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import check_outputs, OutputFile, PICTURE_SUFFIXES
from bev_preheat.optional_packages import is_installed, require

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURE_DPI = 75


class Result:
    """A result: `in_words()` is its line, `plot` its picture; a notebook shows both."""

    def in_words(self) -> str:
        """Return the result as one short line."""
        raise NotImplementedError

    def _figure(self) -> Figure:
        """Return the picture of the command."""
        raise NotImplementedError

    def _draw(self, axis: Axes) -> None:
        """Draw the most important panel."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """Return the line with the name of the class."""
        return f'<{type(self).__name__}: {self.in_words()}>'

    def _repr_html_(self) -> str:
        """Return line and picture for a notebook; without matplotlib the line."""
        text = f'<p>{escape(self.in_words())}</p>'
        if not is_installed('matplotlib'):
            return text
        drawn = io.BytesIO()
        self._figure().savefig(drawn, format='png', dpi=PICTURE_DPI)
        return f'{text}<img alt="" src="data:image/png;base64,{b64encode(drawn.getvalue()).decode()}">'

    def plot(self, file: str | Path | None = None, ax: Axes | None = None) -> Axes | list[Axes]:
        """
        Draw the result and return its axes; needs matplotlib.

        Without `ax` all panels are drawn, those of the command's picture, into `file` if given (PNG, SVG, PDF by
        suffix), and a list of their axes is returned. With `ax` the most important panel is drawn there.
        """
        require('matplotlib')
        check_outputs([OutputFile('file', file, PICTURE_SUFFIXES)])
        if ax is not None:
            if file is not None:
                raise InvalidInput('plot: file and ax are given; keep one of them')
            if not hasattr(ax, 'get_figure'):
                raise InvalidInput(f'ax: must be Axes of Matplotlib, not {type(ax).__name__}')
            self._draw(ax)
            return ax
        figure = self._figure()
        if file is not None:
            from bev_preheat.drawing.figure import save_figure
            save_figure(figure, file)
        return list(figure.axes)
