# SPDX-License-Identifier: Apache-2.0
"""Reasons that keep the heater off regardless of the plan."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.control.decision import Decision, WITHOUT_ROUTE
from bev_preheat.control.inputs import NS_PER_S
from bev_preheat.planning.status import Status

if TYPE_CHECKING:
    from bev_preheat.control.admitted import AdmittedInputs


def find_obstacle(inputs: AdmittedInputs, now_ns: int) -> Decision | None:
    """Return a Decision that keeps the heater off at an instant [ns]; None if nothing forbids heating."""
    if not inputs.is_enabled:
        return Decision(Status.DISABLED, 'Preheating is switched off through ~/enable.')
    if inputs.rivals:
        return Decision(Status.COMMAND_CONFLICT, 'hvch_command is also published by '
                        f'{inputs.rivals}; the heater is off until only one is left.')
    if inputs.refusal is not None:
        return Decision(Status.INVALID_INPUT, inputs.refusal)
    if inputs.active_timetable is None:
        return _cancelled(inputs) if inputs.is_cancelled else WITHOUT_ROUTE
    if inputs.measurement is None:
        return Decision(Status.NO_BATTERY_STATE, 'No valid battery state has arrived yet.')
    age_s = (now_ns - inputs.measurement.stamp_ns) / NS_PER_S
    timeout_s, tolerance_s = inputs.settings.battery_state_timeout_s, inputs.settings.clock_tolerance_s
    if age_s >= timeout_s:
        also = '' if inputs.doubt is None else f' {inputs.doubt}'
        return Decision(Status.STALE_INPUT, f'battery_state is {age_s:.3f} s old; less than '
                        f'{timeout_s:g} s are allowed.{also}')
    if age_s < -tolerance_s:
        return Decision(Status.STALE_INPUT, f'battery_state is stamped {-age_s:.3f} s ahead '
                        f'of the clock; at most {tolerance_s:g} s are allowed.')
    if inputs.doubt is not None:
        return Decision(Status.INVALID_INPUT, inputs.doubt)
    return None


def _cancelled(inputs: AdmittedInputs) -> Decision:
    before, wanted = (' before the planner restarted', 'route plan with another stamp'
                      ) if inputs.is_cancelled_before_restart else ('', 'new route plan')
    return Decision(Status.NO_CHARGING_PLANNED,
                    f'The trip was cancelled{before}: no heating until a {wanted} arrives.')
