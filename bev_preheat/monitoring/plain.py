# SPDX-License-Identifier: Apache-2.0
"""Values for JSON: a browser's parser knows neither NaN nor infinity."""

from __future__ import annotations

import json
import math
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

# Values beyond this are no measurement of a car, and no scale of a chart fits them.
MOST_VALUE = 1e9


def number(value: float | None, digits: int = 3) -> float | None:
    """Return a number rounded for display; None if it is unknown, infinite or beyond MOST_VALUE."""
    if value is None or not math.isfinite(value) or abs(value) > MOST_VALUE:
        return None
    return round(value, digits)


def instant(value: float | None) -> float | None:
    """Return an instant [s] in milliseconds' resolution; None if it is unknown or unset."""
    return None if value is None or not math.isfinite(value) or value <= 0.0 else round(value, 3)


def instants(values: Sequence[float]) -> list[float | None]:
    """Return the instants of a column [s]."""
    return [instant(value) for value in values]


def numbers(values: Sequence[float], digits: int = 3) -> list[float | None]:
    """Return the numbers of a column."""
    return [number(value, digits) for value in values]


def written(value: Any) -> str:
    """Return a value as JSON, without characters that end a script element."""
    return json.dumps(value, separators=(',', ':'), allow_nan=False).replace('<', '\\u003c')
