# SPDX-License-Identifier: Apache-2.0
"""What a study has computed already: read from its results file, and written to it as it comes."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any, Generic, TYPE_CHECKING, TypeVar

from bev_preheat.errors import InvalidInput
from bev_preheat_studies.results_file import ResultsFile
from bev_preheat_studies.sources import sources

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from bev_preheat.files.output_files import AnyPath

Result = TypeVar('Result')


@dataclass(frozen=True)
class Kept(Generic[Result]):
    """Results of trips by number, and what `run_numbered` is to call with each new one."""

    finished: dict[int, Result] = field(default_factory=dict)
    keep: Callable[[int, Result], object] | None = None


def open_results(path: AnyPath, study: Mapping[str, Any]) -> ResultsFile:
    """Return the ResultsFile of the study that plain values describe, as these sources compute it."""
    return ResultsFile(path, {**study, 'program': sources()})


def results_of(file: ResultsFile, path: AnyPath,
               result_from: Callable[[dict[str, Any]], Result]) -> Iterator[Result]:
    """Return the results in a file, one at a time; raise InvalidInput where a line is none."""
    for line, record in enumerate(file.records(), start=2):
        try:
            result = result_from(record)
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise InvalidInput(f'{path}: line {line} is no result of this study') from error
        yield result


@contextmanager
def kept_results(path: AnyPath | None, study: Mapping[str, Any],
                 result_from: Callable[[dict[str, Any]], Result]) -> Iterator[Kept[Result]]:
    """
    Give the Kept results of the study that plain values describe; none of them where `path` is None.

    Results are dataclasses with a `number`; `result_from` makes one from what `asdict` made of it.
    Raises InvalidInput where the file holds another study, or is damaged.
    """
    if path is None:
        yield Kept()
        return
    with open_results(path, study) as file:
        finished: dict[int, Any] = {
            result.number: result  # type: ignore[attr-defined]
            for result in results_of(file, path, result_from)}
        yield Kept(finished, lambda number, result: file.append(
            asdict(result)))  # type: ignore[call-overload]
