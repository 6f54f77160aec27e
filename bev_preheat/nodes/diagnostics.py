# SPDX-License-Identifier: Apache-2.0
"""The planner's entry in /diagnostics."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from bev_preheat.nodes.convert import time_message
from bev_preheat.planning.status import Status

# WARN: works, but someone should know. ERROR: an input or the planner itself is at fault.
LEVELS = {
    Status.NO_ROUTE: DiagnosticStatus.WARN,
    Status.NO_BATTERY_STATE: DiagnosticStatus.WARN,
    Status.TARGET_UNREACHABLE: DiagnosticStatus.WARN,
    Status.SOC_LIMITED: DiagnosticStatus.WARN,
    Status.POWER_LIMITED: DiagnosticStatus.WARN,
    Status.STALE_INPUT: DiagnosticStatus.ERROR,
    Status.INVALID_INPUT: DiagnosticStatus.ERROR,
    Status.INTERNAL_ERROR: DiagnosticStatus.ERROR,
}


def planner_diagnostics(node_name, supervisor, now_ns):
    """Return the DiagnosticArray that tells status, reason and the figures behind them."""
    decision = supervisor.decision
    values = {
        'vehicle': supervisor.vehicle.name,
        'method': supervisor.settings.method,
        'route_id': supervisor.mission.route_id if supervisor.mission else '',
        'legs after this one': str(len(decision.later_legs)),
        'enabled': str(supervisor.enabled).lower(),
        'command [W]': f'{supervisor.command(now_ns).battery_heating_power_w:.0f}',
    }
    if supervisor.measurement is not None:
        state = supervisor.measurement.state
        values['battery temperature [degC]'] = f'{state.temperature_c:.2f}'
        values['state of charge [1]'] = f'{state.soc:.4f}'
        values['battery state age [s]'] = \
            f'{(now_ns - supervisor.measurement.stamp_ns) * 1e-9:.2f}'
    if decision.plan is not None:
        plan = decision.plan
        values['predicted arrival temperature [degC]'] = f'{plan.arrival_temperature_c:.2f}'
        values['predicted arrival state of charge [1]'] = f'{plan.arrival_soc:.4f}'
        values['planning time [ms]'] = f'{plan.planning_time_s * 1e3:.3f}'
    message = DiagnosticArray(status=[DiagnosticStatus(
        name=f'{node_name.lstrip("/")}: preheating',
        hardware_id=supervisor.vehicle.name,
        level=LEVELS.get(decision.status, DiagnosticStatus.OK),
        message=f'{decision.status.name}: {decision.explanation}',
        values=[KeyValue(key=key, value=value) for key, value in values.items()])])
    message.header.stamp = time_message(now_ns)
    return message
