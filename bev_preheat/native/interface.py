# SPDX-License-Identifier: Apache-2.0
"""
The interface on which C and Python must agree: structs, prototypes, memory and shared constants, and its digest.

The C build computes the digest from the headers, Python from its bindings.
"""

from __future__ import annotations

from collections.abc import Mapping
from ctypes import Array, c_double, c_int32, c_void_p, Structure
from dataclasses import dataclass
from hashlib import sha256
from typing import Any, TypeAlias

# (name, type, count) of each field: P an address, D a double, I an integer, else the name of a struct.
Fields: TypeAlias = tuple[tuple[str, str, int], ...]
# Memory of a function: for each step, and once.
Room: TypeAlias = tuple[int, int]
LETTERS = {c_void_p: 'P', c_double: 'D', c_int32: 'I'}


@dataclass(frozen=True)
class Interface:
    """Number, structs, prototypes (letters as of Fields, one for each argument) and memory."""

    number: int
    structs: Mapping[str, Fields]
    functions: Mapping[str, str]
    memory: Mapping[str, Room]

    def digest(self, constants: Mapping[str, float]) -> int:
        """Return a number of 31 bits that is almost surely unique to this interface and these shared constants."""
        text = repr((self.number, *(sorted(each.items()) for each in (
            self.structs, self.functions, self.memory, constants))))
        return int.from_bytes(sha256(text.encode()).digest()[:4], 'big') >> 1


def fields_of(struct: type[Structure], names: Mapping[type[Any], str]) -> Fields:
    """Return the Fields of a Structure; `names` are those in C of the structs within."""
    found = []
    declared: Any
    for name, declared, *_ in struct._fields_:
        is_array = issubclass(declared, Array)
        kind, count = (declared._type_, declared._length_) if is_array else (declared, 1)
        found.append((name, LETTERS.get(kind) or names.get(kind, kind.__name__), count))
    return tuple(found)
