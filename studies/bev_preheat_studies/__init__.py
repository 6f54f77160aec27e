# SPDX-License-Identifier: Apache-2.0
"""Studies that measure the planner. BEV_PREHEAT_WITHOUT_STUDIES=1 leaves them out of a build for a car."""

# Import first: sets OPENBLAS_NUM_THREADS before NumPy loads, so that a measured process runs as the product does.
import bev_preheat  # noqa: F401
