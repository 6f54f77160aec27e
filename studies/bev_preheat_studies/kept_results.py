# SPDX-License-Identifier: Apache-2.0
"""Earlier results of a study: read from its results file; new results are appended to the file."""

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
    """Results by trip number; `keep` of `run_numbered` appends each new result."""

    finished: dict[int, Result] = field(default_factory=dict)
    keep: Callable[[int, Result], object] | None = None


def open_results(path: AnyPath, study: Mapping[str, Any]) -> ResultsFile:
    """Return the ResultsFile of a study, identified by the plain values in `study` and by these sources."""
    return ResultsFile(path, {**study, 'program': sources()})


def results_of(file: ResultsFile, path: AnyPath,
               result_from: Callable[[dict[str, Any]], Result]) -> Iterator[Result]:
    """Return the results in a file, one at a time; raise InvalidInput if a line is not a result."""
    for line, record in enumerate(file.records(), start=2):
        try:
            result = result_from(record)
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise InvalidInput(f'{path}: line {line} is not a result of this study') from error
        yield result


@contextmanager
def kept_results(path: AnyPath | None, study: Mapping[str, Any],
                 result_from: Callable[[dict[str, Any]], Result]) -> Iterator[Kept[Result]]:
    """
    Give the Kept results of a study, identified by the plain values in `study`; empty if `path` is None.

    Results are dataclasses with a `number`; `result_from` is the inverse of `asdict`.
    Raises InvalidInput if the file holds another study or is damaged.
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
