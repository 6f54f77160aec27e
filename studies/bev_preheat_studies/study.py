# SPDX-License-Identifier: Apache-2.0
"""
The one loop of all studies: draw numbered situations, run them on workers, keep the results, show them.

A study is a task, a picklable function of a situation's number, whose result depends on that number only. The
results are therefore the same in one process, on all cores, and in two halves.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Future
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from itertools import count, islice
import os
from typing import Any, Generic, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

from bev_preheat.commands.output import add_json_argument, add_output_arguments, check_output_arguments, write_json
from bev_preheat.commands.parser import option_group, Subparsers
from bev_preheat.commands.program import keeping_what_is_finished, WorkerLost
from bev_preheat.commands.situation import LESS_COMMON
from bev_preheat.commands.terminal import progress_bar, result_console
from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import AnyPath, OutputFile
from bev_preheat_studies.results_file import ResultsFile
from bev_preheat_studies.workers import Workers

Result = TypeVar('Result')

# Situations submitted per core at a time, so that no core waits while a long one holds up the results.
AHEAD = 8
LIMITS = {'jobs': (1, 1024), 'seed': (0, 2**31)}
MOST_SITUATIONS = 100_000


@dataclass(frozen=True)
class Study(Generic[Result]):
    """
    A study of `wanted` situations.

    `task` runs one situation and returns its result, a dataclass of type `result` with the situation's `number`.
    `identity` are the plain values on which the results depend, for a results file. Situations are drawn until
    `wanted` of them count (`counts`; None: each does). `what` names them, in the plural.
    """

    task: Callable[[int], Result]
    result: type[Result]
    wanted: int
    identity: Mapping[str, Any] = field(default_factory=dict)
    counts: Callable[[Result], bool] | None = None
    what: str = 'trips'

    def run(self, jobs: int | None, results: AnyPath | None = None) -> Iterator[Result]:
        """
        Return an iterator over the results in order, computed by `jobs` processes (None: one for each core).

        Those that are in the file of `results` are read, others are appended to it. Raises WorkerLost if a process
        dies, and InvalidInput if the file holds another study.
        """
        with ExitStack() as stack:
            file = None if results is None else stack.enter_context(ResultsFile(results, self.identity))
            finished: dict[int, Any] = {} if file is None else {
                result.number: result for result in file.results(self.result)}  # type: ignore[attr-defined]
            cores = jobs or os.cpu_count() or 1
            workers = None if cores == 1 else stack.enter_context(Workers(self.task, cores))

            def begin(number: int) -> tuple[int, Future[Result]]:
                if workers is not None and number not in finished:
                    return number, workers.begin(number)
                known: Future[Result] = Future()
                known.set_result(finished[number] if number in finished else self.task(number))
                return number, known

            numbers = iter(range(self.wanted) if self.counts is None else count())
            counted = 0
            try:
                begun = deque(map(begin, islice(numbers, AHEAD * cores if cores > 1 else 1)))
                while begun and counted < self.wanted:
                    number, future = begun.popleft()
                    result = future.result()
                    if file is not None and number not in finished:
                        file.append(asdict(result))  # type: ignore[call-overload]
                    counted += self.counts is None or self.counts(result)
                    yield result
                    if counted < self.wanted:
                        begun.extend(map(begin, islice(numbers, 1)))
            except BrokenExecutor:
                raise WorkerLost from None

    def conduct(self, arguments: Namespace, show: Callable[[Console, list[Result]], Any]) -> int:
        """
        Run the study with a progress bar; returns 0.

        `show(console, results)` prints the finished results, if there are any, and returns the
        contents of the JSON file, besides these results. After an interruption the finished results are shown.
        """
        found: list[Result] = []
        with (keeping_what_is_finished() as ending,
              progress_bar(TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(),
                           TimeElapsedColumn()) as bar):
            task = bar.add_task(self.what, total=self.wanted)
            for result in self.run(arguments.jobs, arguments.results):
                found.append(result)
                bar.update(task, advance=self.counts is None or self.counts(result))
        if found:
            console = result_console(arguments.json)
            if not ending.is_complete:
                console.print('Interrupted: only part of the study has run.')
            contents = show(console, found)
            if arguments.json:
                write_json(arguments.json, {
                    **self.identity, 'complete': ending.is_complete, **contents,
                    'results': [asdict(result) for result in found]})  # type: ignore[call-overload]
        counted = sum(self.counts is None or self.counts(result) for result in found)
        ending.tell(counted, self.wanted, self.what, (arguments.json, arguments.plot),
                    arguments.results)
        return 0


def add_study(subparsers: Subparsers, name: str, run: Callable[[Namespace], int], description: str | None,
              summary: str, wanted: str = 'trips', most: int = 100, plots: bool = False) -> ArgumentParser:
    """Add a study with its number of situations (`--WANTED`, default `most`) and return its parser."""
    parser = subparsers.add_parser(name, description=description, help=summary)
    parser.add_argument(f'--{wanted}', type=int, default=most, metavar='N',
                        help='how many are drawn, or compared if some cannot be (default: %(default)s)')
    add_study_arguments(parser, plots)
    parser.set_defaults(run=run)
    return parser


def add_study_arguments(parser: ArgumentParser, plots: bool = True) -> None:
    """Add `--json`, `--seed`, `--jobs` and `--results`, and `--plot` if the study `plots`."""
    (add_output_arguments if plots else add_json_argument)(parser)
    parser.set_defaults(plot=None)
    more = option_group(parser, LESS_COMMON)
    more.add_argument('--seed', type=int, default=1, help='default: %(default)s')
    more.add_argument('--jobs', type=int, metavar='N', help='processes (default: all cores)')
    more.add_argument('--results', metavar='FILE',
                      help='append each result to this file (JSON lines); if the file exists, the study resumes '
                      'from it')


def check_study_arguments(arguments: Namespace, inputs: Sequence[AnyPath] = (), wanted: str = 'trips',
                          **limits: tuple[float, float]) -> None:
    """
    Check the arguments of a study before it starts; `inputs` are the files that it reads.

    `wanted` is the option with the number of situations; `limits` are (low, high) of the study's own options.
    Raises InvalidInput.
    """
    check_ranges(arguments, {**LIMITS, wanted: (1, MOST_SITUATIONS), **limits})
    check_output_arguments(arguments, inputs, [OutputFile('--results', arguments.results)])


def check_ranges(arguments: Namespace, limits: Mapping[str, tuple[float, float]]) -> None:
    """Raise InvalidInput that names all options outside their limits (low, high)."""
    problems = [f'--{name}: {value:g} is not allowed; it must be {low:g} ... {high:g}'
                for name, (low, high) in limits.items()
                if (value := getattr(arguments, name, None)) is not None and not low <= value <= high]
    if problems:
        raise InvalidInput(problems)


def distribution(values: Iterable[float | None], **percents: float) -> dict[str, float]:
    """Return percentiles of the values that are known, by name; {} without any."""
    known = [value for value in values if value is not None]
    return {name: float(np.percentile(known, percent)) for name, percent in percents.items()} if known else {}


def text_of(value: float | None, form: str, factor: float = 1.0) -> str:
    """Return a figure in a format, '–' if it is not known."""
    if value is None:
        return '–'
    return format(value if isinstance(value, int) and factor == 1.0 else factor * value, form)


@dataclass(frozen=True)
class Requirement:
    """A figure with its unit (None: not available), its bound as a text, and whether it is met (None: unknown)."""

    name: str
    bound: str
    value: float | None
    unit: str
    met: bool | None

    @property
    def judged(self) -> Text:
        """The figure with 'met' or 'not met'."""
        if self.met is None:
            return Text('no trip to compare')
        text = text_of(self.value, 'd' if isinstance(self.value, int) else '+.2f')
        return Text.assemble(f'{text} {self.unit}'.rstrip(), ' ',
                             ('met', 'green') if self.met else ('not met', 'red'))


def at_most(name: str, bound: float, value: float | None, unit: str = '', form: str = '+g') -> Requirement:
    """Return the Requirement that a figure is at most a bound; 0: that there is none."""
    return Requirement(name, f'at most {bound:{form}} {unit}'.rstrip() if bound else 'none', value, unit,
                       None if value is None else value <= bound)


def at_least(name: str, bound: float, value: float | None, unit: str = '', form: str = '+g') -> Requirement:
    """Return the Requirement that a figure is at least a bound."""
    return Requirement(name, f'at least {bound:{form}} {unit}'.rstrip(), value, unit,
                       None if value is None else value >= bound)
