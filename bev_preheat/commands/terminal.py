# SPDX-License-Identifier: Apache-2.0
"""Consoles: results on stdout, or on stderr beside JSON; tables stack columns that do not fit, and cut no name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import Progress, ProgressColumn
from rich.table import Table
from rich.text import Text

from bev_preheat.commands.program import discard_output, OutputFailed

# A rich Text if it has a colour.
Cell = str | Text

# Width of a table besides the text: a line and a blank on both sides of each column.
FRAME_WIDTH, COLUMN_FRAME_WIDTH = 1, 3
LEAST_COLUMN_WIDTH = 12


class ResultConsole(Console):
    """A console that falls silent when its reader has gone, as in `… | head -1`."""

    def print(self, *things: Any, **options: Any) -> None:
        """Print as rich does; raise OutputFailed if the output is full."""
        try:
            super().print(*things, **options)
        except BrokenPipeError:
            self._discard()
        except OSError as error:
            self._discard()
            if not self.stderr:
                raise OutputFailed(error) from error

    def say(self, *sentences: str | None, style: str | None = None) -> None:
        """Print each sentence that is not empty as it is, on lines as long as they are."""
        for sentence in filter(None, sentences):
            self.print(sentence, style=style, markup=False, soft_wrap=True)

    def on_broken_pipe(self) -> None:
        """Leave it to `print`, because newer versions of rich would end the process here."""
        raise  # noqa: PLE0704  rich calls this while it handles the error

    def _discard(self) -> None:
        # Unwritten text must not be retried.
        self.quiet = True
        if not self.stderr:
            discard_output()


def result_console(json_path: str | None = None, **options: Any) -> ResultConsole:
    """Return the console for tables and sentences; `json_path` '-' reserves stdout for JSON."""
    return ResultConsole(stderr=json_path == '-', highlight=False, **options)


def progress_console() -> ResultConsole:
    """Return the console for transient progress output."""
    return ResultConsole(stderr=True, highlight=False)


def progress_bar(*columns: str | ProgressColumn) -> Progress:
    """Return a rich Progress that is shown in terminals only, and disappears afterwards."""
    console = progress_console()
    # Older versions of rich end with an empty line even if nothing is shown.
    console.quiet = not console.is_interactive
    return Progress(*columns, console=console, transient=True, disable=console.quiet)


def print_figures(console: Console, title: str | None, headings: Sequence[Cell],
                  rows: Iterable[Sequence[Cell]]) -> None:
    """Print a table of figures, a column an item after the first, in several tables if they do not fit."""
    columns = [[_text(cell) for cell in column] for column in zip(headings, *rows)]
    label, *items = columns
    room = console.width - FRAME_WIDTH - COLUMN_FRAME_WIDTH - _width(label)
    while items:
        count, left = 0, room
        while count < len(items) and left >= _width(items[count]) + COLUMN_FRAME_WIDTH:
            left -= _width(items[count]) + COLUMN_FRAME_WIDTH
            count += 1
        shown, items = items[:max(count, 1)], items[max(count, 1):]
        kept = [number for number, cells in enumerate(zip(*shown))
                if number == 0 or any(cell.plain for cell in cells)]
        _print_table(console, title, [[column[number] for number in kept]
                                      for column in (label, *shown)],
                     ['left'] + ['right'] * len(shown))
        title = None


def print_records(console: Console, title: str, headings: Sequence[Cell],
                  rows: Iterable[Sequence[Cell]], justify: Sequence[str] = ()) -> None:
    """Print a table of records, columns justified 'left' (default) or 'right'; stacked if they do not fit."""
    columns = [[_text(cell) for cell in column] for column in zip(headings, *rows)]
    least = sum(_longest_word(column) + COLUMN_FRAME_WIDTH for column in columns) + FRAME_WIDTH
    if least <= console.width:
        _print_table(console, title, columns, justify or ['left'] * len(columns))
        return
    console.print(Text(title, style='bold'))
    for row in zip(*(column[1:] for column in columns)):
        first, *others = (
            Text.assemble(heading, ': ' if heading.plain else '', cell)
            for heading, cell in zip((column[0] for column in columns), row) if cell.plain)
        console.print(first)
        for line in others:
            console.print(Text.assemble('  ', line))


def _print_table(console: Console, title: str | None, columns: Sequence[Sequence[Text]],
                 justify: Sequence[str]) -> None:
    table = Table(title=title and escape(title))
    room = console.width - FRAME_WIDTH - COLUMN_FRAME_WIDTH * len(columns)
    for column, side, width in zip(columns, justify, _widths(columns, room)):
        table.add_column(column[0], justify='right' if side == 'right' else 'left', width=width,
                         overflow='fold')
    for row in zip(*(column[1:] for column in columns)):
        table.add_row(*row)
    console.print(table)


def _widths(columns: Sequence[Sequence[Text]], room: int) -> list[int]:
    """Return the widths of columns: at most `room` in total, unless a word would have to break."""
    widths, least = list(map(_width, columns)), list(map(_longest_word, columns))
    while sum(widths) > room:
        spare = [number for number, width in enumerate(widths) if width > least[number]]
        if not spare:
            # Only for words longer than the terminal's width, such as paths of files.
            spare = [number for number, width in enumerate(widths) if width > LEAST_COLUMN_WIDTH]
        if not spare:
            break
        widths[max(spare, key=widths.__getitem__)] -= 1
    return widths


def _text(cell: Cell) -> Text:
    return cell if isinstance(cell, Text) else Text(cell)


def _width(column: Iterable[Text]) -> int:
    return max(cell.cell_len for cell in column)


def _longest_word(column: Iterable[Text]) -> int:
    return max((Text(word).cell_len for cell in column for word in cell.plain.split()), default=0)
