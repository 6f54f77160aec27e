# SPDX-License-Identifier: Apache-2.0
"""
Studies that measure the planner. BEV_PREHEAT_WITHOUT_STUDIES=1 leaves them out of a build for a car.

`robustness`: drawn cars. `optimality`: drawn trips against the nonlinear program. `fleet`: the minutes
that each method saves at the charger. `reproduction`: the paper's Table II. `soak`: the installed planner
under load. `cost`: time and memory. `footprint`: bytes, stack and instructions of an export. `commands`:
`preheat sweep`, `robustness` and `reproduce`.
"""

# Import first: sets OPENBLAS_NUM_THREADS before NumPy loads, so that a measured process runs as the product does.
import bev_preheat  # noqa: F401
