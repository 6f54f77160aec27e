# SPDX-License-Identifier: Apache-2.0
"""Run plans of a build on this computer, and measure the stack by filling it beforehand."""

from __future__ import annotations

import struct
import subprocess
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat_studies.footprint.situations import Planned

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bev_preheat_studies.footprint.builds import Build
    from bev_preheat_studies.footprint.situations import FootprintCase

# Status, bytes of stack, and ANSWER_NUMBERS of planned.h.
ANSWER = struct.Struct('=2i10d')


class PaintedStack:
    """The program of painted_stack.c."""

    def __init__(self, build: Build) -> None:
        """Link the program. Symbols are bound at the start: lazy binding inside a plan would use stack."""
        self._program: Path = build.link('painted_stack', 'painted_stack.c', '-Wl,-z,now')

    def memory_bytes(self, steps: int) -> tuple[int, int, int]:
        """Return the memory for this many steps: optimal_switch, the same with a heat path, value_function."""
        direct, late, values = map(int, self._run(b'', 'memory', str(steps)).split())
        return direct, late, values

    def plan(self, asked: Sequence[tuple[int, FootprintCase]]) -> list[Planned]:
        """Return the results of (method number, FootprintCase) pairs."""
        given = b''.join(struct.pack('=2i', method, situation.steps) + situation.numbers.tobytes()
                         for method, situation in asked)
        return [Planned(status, stack_bytes, None, tuple(told)) for status, stack_bytes, *told in
                ANSWER.iter_unpack(self._run(given, 'plans'))]

    def _run(self, given: bytes, *arguments: str) -> bytes:
        done = subprocess.run([self._program, *arguments], input=given, check=False, capture_output=True)
        if done.returncode != 0:
            raise InvalidInput(f'{self._program.name} {arguments[0]} ends with {done.returncode}')
        return done.stdout
