# SPDX-License-Identifier: Apache-2.0
"""
Everything that measures the planner. A build with BEV_PREHEAT_WITHOUT_STUDIES=1 leaves it out of a car.

`robustness`: drawn cars. `optimality`: drawn trips against the nonlinear program. `fleet`: the minutes
that each method saves at the charger. `reproduction`: the paper's Table II. `soak`: the installed planner
under load. `cost`: time and memory. `footprint`: bytes, stack and instructions of an export. `commands`:
`preheat sweep`, `robustness` and `reproduce`.
"""

# Sets OPENBLAS_NUM_THREADS before NumPy loads, so that a measured process runs as the product does.
import bev_preheat  # noqa: F401
