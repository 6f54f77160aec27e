# SPDX-License-Identifier: Apache-2.0
"""The folder of an export: its files, and how they are written."""

from __future__ import annotations

from collections.abc import Callable
import os
from typing import TYPE_CHECKING

from bev_preheat.code_generation.ecu_constants import example_source, vehicle_source
from bev_preheat.code_generation.ecu_sources import core_sources, own_sources
from bev_preheat.code_generation.ecu_vectors import draw_vectors, first_heated, vectors_text
from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import check_outputs, expanded, OutputFile, write_whole

if TYPE_CHECKING:
    from pathlib import Path

    from bev_preheat.code_generation.ecu_vectors import Vector
    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.vehicle.description import Vehicle

MADE = ('example.c', 'vectors.txt', 'vehicle.c')
# Output of the export's Makefile.
BUILD = 'build'


class Export:
    """An export of one vehicle: checked first, then written."""

    def __init__(self, vehicle: Vehicle, folder: AnyPath, inputs: list[Path]) -> None:
        """
        Collect the files that need no planning, and check that the export can be written.

        `inputs` are the files that were read. Raises InvalidInput if the folder cannot be made or has
        files that do not belong to an export, if the vehicle cannot be exported, and if the sources of
        the core are missing.
        """
        if vehicle.heating_gates.is_any:
            raise InvalidInput('heating_gates: the exported sources do not know them; export a file without '
                               'heating_gates, and keep them in the control unit')
        self._vehicle, self._folder = vehicle, expanded(folder)
        self._files = {**core_sources(), **own_sources(), 'vehicle.c': vehicle_source(vehicle)}
        names = {*self._files, *MADE}
        self._check_folder(folder, names)
        try:
            check_outputs([OutputFile('--output', os.path.join(folder, name), make_folder=True)
                           for name in sorted(names)], inputs)
        except InvalidInput as error:
            # A problem of the folder is a problem of each of its files: raise only the first.
            raise InvalidInput(error.problems[0]) from error

    def write(self, count: int, seed: int, report: Callable[[], None]) -> list[Vector]:
        """Draw `count` vectors, write all files, and return the vectors; `report` is called after each."""
        vectors = draw_vectors(self._vehicle, count, seed, report)
        example = first_heated(vectors)
        self._files['example.c'] = example_source(example.columns, example.situation)
        self._files['vectors.txt'] = vectors_text(vectors)
        for name, text in self._files.items():
            write_whole(os.path.join(self._folder, name), text, make_folder=True)
        return vectors

    def _check_folder(self, folder: AnyPath, names: set[str]) -> None:
        """Raise InvalidInput if a folder has files that an export does not write."""
        if not os.path.lexists(self._folder):
            return
        if not os.path.isdir(self._folder):
            raise InvalidInput(f'--output: {os.fspath(folder)}: is not a folder')
        ours = {name.partition('/')[0] for name in names} | {BUILD}
        try:
            others = sorted(set(os.listdir(self._folder)) - ours)
        except OSError as error:
            raise InvalidInput(f'--output: {os.fspath(folder)}: cannot be read: {error.strerror}') from error
        if others:
            raise InvalidInput(f'--output: {os.fspath(folder)}: has files that an export does not write: '
                               f'{", ".join(others[:3])}{" …" if len(others) > 3 else ""}; '
                               'name a folder of its own')
