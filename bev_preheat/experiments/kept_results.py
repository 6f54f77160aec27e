# SPDX-License-Identifier: Apache-2.0
"""What a study has computed already: read from its results file, and written to it as it comes."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any, Generic, TYPE_CHECKING, TypeVar

from bev_preheat.errors import InvalidInput
from bev_preheat.experiments.sources import sources
from bev_preheat.files.results_file import ResultsFile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from bev_preheat.files.output_files import AnyPath

Result = TypeVar('Result')


@dataclass(frozen=True)
class Kept(Generic[Result]):
    """Results of trips by number, and what `run_numbered` is to call with each new one."""

    finished: dict[int, Result] = field(default_factory=dict)
    keep: Callable[[int, Result], object] | None = None


@contextmanager
def kept_results(path: AnyPath | None, study: Mapping[str, Any],
                 result_from: Callable[[dict[str, Any]], Result],
                 as_record: Callable[[Result], dict[str, Any]] = asdict,  # type: ignore[assignment]
                 ) -> Iterator[Kept[Result]]:
    """
    Give the Kept results of the study that plain values describe; none of them where `path` is None.

    Results have a `number`; `result_from` makes one from what `as_record` made of it.
    Raises InvalidInput where the file holds another study, or is damaged.
    """
    if path is None:
        yield Kept()
        return
    with ResultsFile(path, {**study, 'program': sources()}) as file:
        finished: dict[int, Result] = {}
        for line, record in enumerate(file.records(), start=2):
            try:
                finished[int(record['number'])] = result_from(record)
            except (KeyError, TypeError, ValueError) as error:
                raise InvalidInput(f'{path}: line {line} is no result of this study') from error
        yield Kept(finished, lambda number, result: file.append(as_record(result)))
