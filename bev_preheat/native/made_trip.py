# SPDX-License-Identifier: Apache-2.0
"""A trip's columns made by the native core."""

from __future__ import annotations

from ctypes import byref
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.native.library import core, OK
from bev_preheat.native.runs import place
from bev_preheat.native.structs import NativeTrip, TRIP_COLUMNS, TripTermsStruct

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.numerics.arrays import FloatArray


def make_trip(terms: Sequence[float], route: FloatArray) -> NativeTrip | None:
    """
    Return the trip of a route, whose columns (8, N) are given in their order; see `bev_make_trip` in core.h.

    `terms` are those of TripTermsStruct. Also None if a step is too long for the integrators.
    """
    library = core()
    if library is None:
        return None
    steps = route.shape[1]
    columns = np.empty(len(TRIP_COLUMNS) * steps + 1)
    status = library.bev_make_trip(
        byref(TripTermsStruct(*terms)), steps, place(route), place(columns))
    return NativeTrip(steps, columns) if status == OK else None
