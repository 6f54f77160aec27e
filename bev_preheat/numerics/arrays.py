# SPDX-License-Identifier: Apache-2.0
"""Names of the kinds of NumPy arrays, for type hints, and arrays that stay as they are."""

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int_]


def frozen(array: FloatArray) -> FloatArray:
    """Return an array, which can no longer be written."""
    array.setflags(write=False)
    return array
