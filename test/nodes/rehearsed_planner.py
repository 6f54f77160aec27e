# SPDX-License-Identifier: Apache-2.0
"""A planner's node in this process that gets one input at a time, at instants that the test sets."""

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.parameter import Parameter
from sensor_msgs.msg import BatteryState
from std_srvs.srv import SetBool

from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

TOPICS = {BatteryState: 'battery_state', RoutePlan: 'route_plan'}


class RehearsedPlanner:
    """The node, its inputs, and recorders of its publications."""

    def __init__(self, rehearsal, start_ns, commands_alone=False):
        """Start it at an instant [ns]; `commands_alone` saves the time of recording plans and diagnostics."""
        self._rehearsal = rehearsal
        self.set_clock(start_ns)
        self.commands = rehearsal.record(HvchCommand, 'hvch_command')
        if not commands_alone:
            self.plans = rehearsal.record(PreheatPlan, 'preheat_plan')
            self.diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics')
        self._publishers = {kind: rehearsal.publisher(kind, topic) for kind, topic in TOPICS.items()}
        self.process = rehearsal.start('planner')

    def set_clock(self, now_ns):
        """Set the time [ns]; no timer fires."""
        self._rehearsal.now_ns = now_ns

    def give(self, message):
        """Publish a BatteryState or a RoutePlan."""
        self._publishers[type(message)].publish(message)

    def repeat(self):
        """Let every timer fire."""
        self._rehearsal.fire_all()

    def enable(self, is_on):
        """Call ~/enable."""
        self._rehearsal.call(SetBool, '/planner/enable', SetBool.Request(data=is_on))

    def set(self, **parameters):
        """Set parameters; return the result of the last."""
        return self.process.node.set_parameters(
            [Parameter(name, value=value) for name, value in parameters.items()])[-1]
