# SPDX-License-Identifier: Apache-2.0
"""PrepareBattery: a goal read and written, feedback and result written."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.fields import highest_given, known, nanoseconds, time_message
from bev_preheat.messages.route_plan import AT_THE_END
from bev_preheat.numerics import NS_PER_S
from bev_preheat_msgs.action import PrepareBattery

if TYPE_CHECKING:
    from bev_preheat.control.preparation_goal import PreparationOutcome
    from bev_preheat.control.state import State


def preparation_goal_of(goal: PrepareBattery.Goal) -> PreparationGoal:
    """Return the PreparationGoal of an action goal; raise InvalidInput, one problem per unreadable field."""
    problems = []
    values = {}
    for name in ('target_battery_temperature', 'ambient_temperature'):
        value, is_given = getattr(goal, name), getattr(goal, f'has_{name}')
        if is_given and not math.isfinite(value):
            problems.append(f'{name}: {value:g} is not allowed where has_{name} is true; it must be finite')
        elif math.isinf(value):
            problems.append(f'{name}: {value:g} is not allowed; it must be finite, or 0 or NaN: not given')
        values[name] = None if not is_given and (value == 0.0 or math.isnan(value)) else float(value)
    most_c = goal.maximum_arrival_temperature
    if problem := AT_THE_END['maximum_arrival_temperature'].problem('maximum_arrival_temperature', most_c):
        problems.append(problem)
    if not (goal.ready_at.sec >= 0 and goal.ready_at.nanosec < NS_PER_S):
        problems.append(f'ready_at: {goal.ready_at.sec} s and {goal.ready_at.nanosec} ns are no instant; '
                        f'seconds must be at least 0, nanoseconds below {NS_PER_S}')
    if problems:
        raise InvalidInput(problems)
    return PreparationGoal(nanoseconds(goal.ready_at), values['target_battery_temperature'], goal.plugged_in,
                           values['ambient_temperature'], maximum_arrival_temperature_c=known(most_c))


def goal_message(goal: PreparationGoal) -> PrepareBattery.Goal:
    """Return the action goal of a PreparationGoal."""
    message = PrepareBattery.Goal(ready_at=time_message(goal.ready_at_ns), plugged_in=goal.is_plugged_in,
                                  maximum_arrival_temperature=highest_given(goal.most_c))
    for name, value_c in (('target_battery_temperature', goal.target_c), ('ambient_temperature', goal.ambient_c)):
        setattr(message, f'has_{name}', value_c is not None)
        setattr(message, name, value_c or 0.0)
    return message


def result_message(outcome: PreparationOutcome) -> PrepareBattery.Result:
    """Return the action result of a PreparationOutcome."""
    return PrepareBattery.Result(
        code=int(outcome.ending), explanation=outcome.explanation,
        reached=outcome.ending is PreparationEnding.REACHED, shortfall=outcome.shortfall_k,
        battery_temperature=outcome.temperature_c)


def feedback_message(state: State, now_ns: int) -> PrepareBattery.Feedback:
    """Return the feedback on a Supervisor's preparation progress at an instant [ns]."""
    decision, command = state.decision, state.latest_command
    preparation_goal = state.preparation_goal
    temperature_c, plan = state.temperature_c, decision.plan
    ready_ns = 0 if preparation_goal is None else preparation_goal.ready_at_ns
    if plan is not None and not ready_ns:
        ready_ns = decision.plan_start_ns + round(plan.arrival_time_s * NS_PER_S)
    return PrepareBattery.Feedback(
        battery_temperature=math.nan if temperature_c is None else temperature_c,
        time_left=max(0.0, (ready_ns - now_ns) / NS_PER_S) if ready_ns else math.nan,
        predicted_battery_temperature=math.nan if plan is None else plan.arrival_temperature_c,
        battery_heating_power=0.0 if command is None else command.total_w,
        status=int(decision.status), explanation=decision.explanation)
