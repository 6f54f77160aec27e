# SPDX-License-Identifier: Apache-2.0
"""Compile an export for a processor with the rules of the export's own Makefile."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from platform import machine
import shutil
import subprocess

from bev_preheat.errors import InvalidInput

HERE = Path(__file__).resolve().parent
# As in the export's Makefile, but without -Werror, which is meant for the export's own sources.
INCLUDES = ('-I.', '-Iinclude', '-Isrc', f'-I{HERE}')


@dataclass(frozen=True)
class Target:
    """A processor and its compiler: name, prefix of the tools, and flags for the processor."""

    name: str
    compiler: str
    tools: str = ''
    flags: tuple[str, ...] = ()

    @property
    def is_this_computer(self) -> bool:
        """Whether the compiled program runs on this computer."""
        return not self.tools

    @property
    def is_there(self) -> bool:
        """Whether the compiler is installed."""
        return shutil.which(self.compiler) is not None

    @property
    def version(self) -> str:
        """The first line of the compiler's --version."""
        return subprocess.run([self.compiler, '--version'], check=True, capture_output=True,
                              text=True).stdout.splitlines()[0]


COMPUTER = Target(machine().replace('_', '-'), 'cc')
CORTEX_M7 = Target('Cortex-M7', 'arm-none-eabi-gcc', 'arm-none-eabi-',
                   ('-mcpu=cortex-m7', '-mthumb', '-mfpu=fpv5-d16', '-mfloat-abi=hard'))
LEVELS = ('-O2', '-Os')


@dataclass(frozen=True)
class Build:
    """
    An export compiled for a Target at a level of optimization, in the export's `folder`.

    `block` is the Makefile's BLOCK: states side by side.
    """

    target: Target
    level: str
    folder: Path
    most_steps: int
    block: int

    def __str__(self) -> str:
        """Return the name for tables."""
        return f'{self.target.name}, {self.level}'

    @property
    def objects(self) -> Path:
        """The folder of the object files."""
        return self.folder / self._build

    def make_library(self) -> None:
        """Compile the export's library; raises InvalidInput if that fails."""
        target = self.target
        self._call('make', '-s', f'BUILD={self._build}', f'CC={target.compiler}', f'AR={target.tools}ar',
                   f'CFLAGS={" ".join(self._flags)}', f'MOST_STEPS={self.most_steps}',
                   f'BLOCK={self.block}', self._library)

    def link(self, name: str, *others: str) -> Path:
        """Return a program linked from the library, `planned.c` and `others`: sources in this folder, or flags."""
        sources = [str(HERE / other) if other.endswith('.c') else other for other in others]
        self._call(self.target.compiler, *self._flags, '-std=c99', '-ffp-contract=off',
                   f'-DBEV_MOST_STEPS={self.most_steps}', *INCLUDES, str(HERE / 'planned.c'), *sources,
                   self._library, '-lm', '-o', f'{self._build}/{name}')
        return self.objects / name

    @property
    def _build(self) -> str:
        # The export treats everything in this folder as its own.
        return f'build/{self.target.name}{self.level}'

    @property
    def _library(self) -> str:
        return f'{self._build}/libbev_ecu.a'

    @property
    def _flags(self) -> tuple[str, ...]:
        return self.level, *self.target.flags

    def _call(self, *command: str) -> None:
        done = subprocess.run(command, check=False, cwd=self.folder, capture_output=True, text=True)
        if done.returncode != 0:
            raise InvalidInput(f'{self}: {command[0]} ends with {done.returncode}: '
                               f'{(done.stderr or done.stdout).strip()[-1000:]}')
