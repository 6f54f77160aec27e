# SPDX-License-Identifier: Apache-2.0
"""
The engine: the ten operations on which planning is built: runs, their limits and energies, and plans.

Each exists twice: in the native core (`core_engine`), and in readable Python, which defines the result. The core
answers if it is used and accepts the vehicle and the numbers; otherwise Python answers, or raises the appropriate
exception. No other module of planning knows that there are two.
"""

from __future__ import annotations

from bev_preheat.native.library import operation
from bev_preheat.planning import core_engine, dynamics, heat_run, limited_drive, recursion, switch_plan
from bev_preheat.planning import model_inputs as python_inputs

# The model's inputs along a route.
model_inputs = operation(core_engine.model_inputs, python_inputs.model_inputs)
# Runs without regard to limits, and within them.
run_forward = operation(core_engine.run_forward, dynamics.run_forward)
run_heated = operation(core_engine.run_heated, heat_run.run_heated)
drive_within_limits = operation(core_engine.drive_within_limits, limited_drive.drive_within_limits)
# Limits of a run, and its energies.
limits_of_steps_w = operation(core_engine.limits_of_steps_w, dynamics.limits_of_steps_w)
keep_accounts = operation(core_engine.keep_accounts, dynamics.keep_accounts)
# Plans.
plan_switch = operation(core_engine.plan_switch, switch_plan.plan_switch)
plan_by_paper = operation(core_engine.plan_by_paper, switch_plan.plan_by_paper)
find_values = operation(core_engine.find_values, recursion.find_values)
follow_values = operation(core_engine.follow_values, recursion.follow_values)
