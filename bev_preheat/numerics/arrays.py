# SPDX-License-Identifier: Apache-2.0
"""Names of the kinds of NumPy arrays, for type hints."""

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int_]
