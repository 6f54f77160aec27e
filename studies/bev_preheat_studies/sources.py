# SPDX-License-Identifier: Apache-2.0
"""Identify the sources that computed a result: other sources may compute another result."""

from __future__ import annotations

from functools import cache
from hashlib import sha256
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import bev_preheat
from bev_preheat.files.configuration import version

if TYPE_CHECKING:
    from typing import Any

# The product and its studies.
PACKAGES = (Path(bev_preheat.__file__).resolve().parent, Path(__file__).resolve().parent)
# Hexadecimal digits that distinguish sources and inputs.
DIGITS = 12


@cache
def sources() -> str:
    """Return version and digest of the Python files and data of both packages, as a text."""
    digest = sha256()
    for package in PACKAGES:
        for path in sorted(package.rglob('*')):
            if path.suffix in ('.py', '.yaml'):
                digest.update(path.relative_to(package.parent).as_posix().encode())
                digest.update(path.read_bytes())
    return f'{version()} ({digest.hexdigest()[:DIGITS]})'


def digest_of(value: Any) -> str:
    """Return a digest of a tree of dataclasses, arrays and plain values; equal trees have equal digests."""
    return sha256(json.dumps(_plain(value)).encode()).hexdigest()[:DIGITS]


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, '__dataclass_fields__'):
        return {type(value).__name__: {name: _plain(getattr(value, name))
                                       for name in value.__dataclass_fields__}}
    return value
