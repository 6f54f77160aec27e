# SPDX-License-Identifier: Apache-2.0
"""Readings whose raw value has all bits set (but the sign), by which control units say that they have none."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import BoolArray, FloatArray

# The largest values of one byte and of two, and the usual resolutions and offset of a signal.
BYTES = tuple(255.0 * step + offset for step in (1.0, 0.5, 0.1) for offset in (0.0, -40.0))
WORDS = tuple(full * step for step in (1.0, 0.1, 0.01, 0.001) for full in (65535.0, 32767.0, -32768.0))
# A reading stands apart if no other is nearer than this share of its value; for one byte, a tenth of a degree is a
# reading, so there a distance [K] that no temperature jumps is needed too.
APART, BYTE_APART_K = 0.1, 15.0
# A sensor may stay at a lower value.
LEAST_CONSTANT = 60.0


def all_ones(numbers: FloatArray, is_temperature: bool, full: tuple[float, ...] = ()) -> BoolArray:
    """
    Return which numbers are all ones and stand apart from the others, shape (N,).

    `full` are the values of all ones if the log tells them; otherwise the usual ones are tried, those of a byte
    for temperatures only, because other signals pass through them.
    """
    finite = np.unique(numbers[np.isfinite(numbers)])
    found: BoolArray = np.zeros(len(numbers), dtype=bool)
    for value in full or (WORDS + BYTES if is_temperature else WORDS):
        same = np.abs(finite - value) <= 1e-6 * max(abs(value), 1.0)
        others = finite[~same]
        if not same.any() or (not others.size and value < LEAST_CONSTANT and not full):
            continue
        least = max(APART * abs(value), BYTE_APART_K if value in BYTES and not full else 0.0)
        if not others.size or np.abs(others - value).min() >= least:
            found |= np.abs(numbers - value) <= 1e-6 * max(abs(value), 1.0)
    return found
