# SPDX-License-Identifier: Apache-2.0
"""
Everything that measures the planner.

`supervised_drive` and `scenario_drive`: a simulated car under the planner's step, without ROS.
`robustness`: drawn cars. `optimality`: drawn trips against the nonlinear program. `reproduction`: the
paper's Table II. `soak`: the installed planner under load. `cost`: time and memory.
"""
