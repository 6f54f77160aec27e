# SPDX-License-Identifier: Apache-2.0
"""Bytes of the object files that a linker takes for one function: code, constants, static variables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

# Sections for stack unwinding and compiler notes, which a C program does not need.
NEVER_USED = ('.eh_frame', '.ARM.exidx', '.ARM.extab', '.note')
# Constants that contain addresses, in a position-independent program.
RELOCATED_CONSTANTS = '.data.rel.ro'
WRITABLE, OCCUPIES_MEMORY, EXECUTABLE = 1, 2, 4


@dataclass(frozen=True)
class Bytes:
    """Bytes of code, constants and static variables."""

    code: int = 0
    constants: int = 0
    variables: int = 0

    def __add__(self, other: Bytes) -> Bytes:
        """Return the sum."""
        return Bytes(self.code + other.code, self.constants + other.constants, self.variables + other.variables)


@dataclass(frozen=True)
class ObjectFile:
    """An object file: its Bytes, and its defined and undefined symbols."""

    path: Path
    size: Bytes
    defines: frozenset[str]
    needs: frozenset[str]


def read_object(path: Path) -> ObjectFile:
    """Return the ObjectFile in a file in ELF format."""
    from elftools.elf.elffile import ELFFile
    from elftools.elf.sections import SymbolTableSection

    size = Bytes()
    defines: set[str] = set()
    needs: set[str] = set()
    with path.open('rb') as file:
        for section in ELFFile(file).iter_sections():
            size += _bytes_of(section.name, section['sh_flags'], section['sh_size'])
            if isinstance(section, SymbolTableSection):
                for symbol in section.iter_symbols():
                    if symbol.name and symbol['st_info']['bind'] != 'STB_LOCAL':
                        (needs if symbol['st_shndx'] == 'SHN_UNDEF' else defines).add(symbol.name)
    return ObjectFile(path, size, frozenset(defines), frozenset(needs))


def _bytes_of(name: str, flags: int, size: int) -> Bytes:
    """Return a section's size, counted as code, constants or variables."""
    if not flags & OCCUPIES_MEMORY or name.startswith(NEVER_USED):
        return Bytes()
    if flags & EXECUTABLE:
        return Bytes(code=size)
    if flags & WRITABLE and not name.startswith(RELOCATED_CONSTANTS):
        return Bytes(variables=size)
    return Bytes(constants=size)


def needed_for(symbols: Iterable[str], files: Iterable[ObjectFile]) -> list[ObjectFile]:
    """Return the files that a program with these symbols links, including dependencies among the files."""
    defined_in = {symbol: file for file in files for symbol in file.defines}
    needed: dict[Path, ObjectFile] = {}
    wanted = [*symbols]
    while wanted:
        file = defined_in.get(wanted.pop())
        if file is not None and file.path not in needed:
            needed[file.path] = file
            wanted.extend(file.needs)
    return [*needed.values()]


def total(files: Iterable[ObjectFile]) -> Bytes:
    """Return the sum of the Bytes of files."""
    return sum((file.size for file in files), Bytes())
