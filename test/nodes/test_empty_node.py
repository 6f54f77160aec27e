# SPDX-License-Identifier: Apache-2.0
"""The empty node that the planner is measured against has the planner's shape."""

from collections import Counter
import subprocess
import sys

import pytest
from rcl_interfaces.srv import ListParameters
from rclpy.serialization import serialize_message
from rclpy.waitable import Waitable
from rehearsal import SilentNode

from bev_preheat.control.events import BatteryStateArrived, RouteArrived
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.messages.preheat_plan import plan_message
from bev_preheat.native.library import DECLINES
from bev_preheat.nodes.diagnostics import planner_diagnostics
from bev_preheat.nodes.planner_node import PlannerNode
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.cost import empty_node

START_NS = 1_700_000_000 * NS_PER_S


def kind(waitable):
    """Return rclpy's name of a waitable; for an action server, the name of its base class."""
    kinds = type(waitable).__mro__
    return kinds[kinds.index(Waitable) - 1].__name__, getattr(waitable, 'event_type', None)


def shape(node):
    """Return the parts of a node by kind."""
    return {
        'parameters': {name: node.get_parameter(name).value
                       for name in node.list_parameters([], ListParameters.Request.DEPTH_RECURSIVE).names},
        'checks of parameters': node.checks,
        'publishers': {part.topic_name: (part.msg_type, part.qos_profile) for part in node.publishers},
        'subscriptions': sorted(
            (part.topic_name, str(part.msg_type), str(part.qos_profile), part.raw)
            for part in node.subscriptions),
        'services': sorted((part.srv_name, str(part.srv_type)) for part in node.services),
        'clients': list(node.clients),
        'timers': sorted((part.timer_period_ns, str(part.clock.clock_type)) for part in node.timers),
        'waitables': Counter(map(kind, node.waitables)),
        'guards': list(node.guards)}


class CountingNode(SilentNode):
    """Counts the functions that are called when parameters are set."""

    def __init__(self, name):
        self.checks = Counter()
        super().__init__(name)

    def add_on_set_parameters_callback(self, callback):
        self.checks['before'] += 1
        super().add_on_set_parameters_callback(callback)

    def add_post_set_parameters_callback(self, callback):
        self.checks['after'] += 1
        super().add_post_set_parameters_callback(callback)


@pytest.fixture
def shapes(silent_context):
    """Return the shapes of planner and empty node."""
    found = []
    for node_class in (PlannerNode, empty_node.EmptyNode):
        node = type('Counted', (node_class, CountingNode), {'silent_context': silent_context})()
        found.append(shape(node))
        node.destroy_node()
    return found


def test_it_has_all_that_the_planner_has(shapes):
    planner, empty = shapes
    assert planner == empty
    # Not that both are empty.
    assert len(planner['publishers']) > 4 and len(planner['timers']) > 4


@pytest.fixture(scope='module')
def supervisor():
    """Give a Supervisor with the reference trip and some minutes of battery states."""
    vehicle, settings = load_vehicle('reference'), Settings()
    leg = Leg(load_route('reference', vehicle.defaults), START_NS, target_temperature_c=25.0)
    supervisor = Supervisor(vehicle, settings)
    mission = Mission('benchmark', (leg,)).in_planning_steps(settings.planning_step_s)
    supervisor.step(START_NS, RouteArrived(mission))
    for second in range(5):
        now_ns = START_NS + second * NS_PER_S
        supervisor.step(now_ns, BatteryStateArrived(Measurement(BatteryState(-7.0, 0.9), now_ns)))
    return supervisor


def test_its_messages_are_as_long_as_the_planners(supervisor):
    now_ns = supervisor.state.measurement.stamp_ns
    # Of other tests in this process.
    DECLINES.counts.clear()
    for its, the_planners in (
            (empty_node.plan_message(),
             plan_message(supervisor.state.decision, supervisor.state.mission, now_ns)),
            (empty_node.diagnostics_message(), planner_diagnostics('/planner', supervisor.state, now_ns))):
        assert len(serialize_message(its)) == pytest.approx(
            len(serialize_message(the_planners)), rel=0.1)


def test_it_loads_nothing_of_the_planner():
    program = ('import sys; import bev_preheat_studies.cost.empty_node; '
               'print(*(name for name in sys.modules if name.startswith("bev_preheat") and "." in name '
               'and not name.startswith("bev_preheat_msgs")))')
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, timeout=60)
    assert set(done.stdout.split()) == {
        'bev_preheat_studies.cost', 'bev_preheat_studies.cost.empty_node'}, done.stderr
