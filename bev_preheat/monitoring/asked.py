# SPDX-License-Identifier: Apache-2.0
"""A request of a person on the page: checked values, and the planner's answer."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from bev_preheat.errors import InvalidInput, quoted

ENABLE, DISABLE, PREPARE, CANCEL, SKIP, UNSKIP = (
    'enable', 'disable', 'prepare', 'cancel', 'skip', 'unskip')
KINDS = (ENABLE, DISABLE, PREPARE, CANCEL, SKIP, UNSKIP)
# As the action has them: a day ahead, and the temperatures of batteries.
MINUTES, TARGETS_C = (1.0, 1440.0), (-60.0, 60.0)


class Asked(NamedTuple):
    """
    A request: its kind; for `prepare` when [min from now], the target [deg C], whether the car is plugged in.

    `minutes` None: as soon as possible. `target_c` None: the planner's own.
    """

    kind: str
    minutes: float | None = None
    target_c: float | None = None
    is_plugged_in: bool = False


class Answer(NamedTuple):
    """Whether the planner serves the request, and its sentence."""

    is_accepted: bool
    text: str


def asked_of(values: Any) -> Asked:
    """Return the Asked of a request's JSON; raises InvalidInput, naming the field."""
    if not isinstance(values, dict):
        raise InvalidInput('the request must be a JSON object')
    kind = values.get('kind')
    if kind not in KINDS:
        raise InvalidInput(f'kind: {quoted(str(kind)[:40])} is not allowed; it must be one of {", ".join(KINDS)}')
    if kind != PREPARE:
        return Asked(kind)
    plugged_in = values.get('pluggedIn', False)
    if not isinstance(plugged_in, bool):
        raise InvalidInput('pluggedIn: must be true or false')
    return Asked(kind, _number(values, 'minutes', MINUTES, 'min'), _number(values, 'target', TARGETS_C, 'degC'),
                 plugged_in)


def _number(values: dict[str, Any], name: str, limits: tuple[float, float], unit: str) -> float | None:
    value, (low, high) = values.get(name), limits
    if value is None:
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not is_number or not low <= value <= high:
        raise InvalidInput(f'{name}: {quoted(str(value)[:40])} is not allowed; it must be {low:g} ... {high:g} '
                           f'{unit}')
    return float(value)
