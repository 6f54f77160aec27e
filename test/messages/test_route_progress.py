# SPDX-License-Identifier: Apache-2.0
"""RouteProgress at the node's boundary, and in the diagnostics; without DDS."""

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from steady_drives import NOW_NS, steady_leg, VEHICLE

from bev_preheat.control.events import ProgressArrived, ProgressUnreadable, RouteArrived
from bev_preheat.control.inputs import Mission, Progress
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.messages.diagnostics import planner_diagnostics
from bev_preheat.messages.route_progress import progress_event
from bev_preheat.numerics import NS_PER_S
from bev_preheat_msgs.msg import RouteProgress


def a_message(**fields):
    message = RouteProgress(**{'route_id': 'home', 'distance': 1200.5, **fields})
    if 'header' not in fields:
        message.header.stamp = Time(sec=1_700_000_060, nanosec=250_000_000)
    return message


def read(message):
    return progress_event(message).progress


def test_a_message_is_read():
    assert read(a_message(route_stamp=Time(sec=1_700_000_000))) == Progress(
        1200.5, NOW_NS + 60_250_000_000, 'home', NOW_NS)
    assert read(a_message()).route_start_ns is None


def test_the_start_is_a_place_where_the_message_says_so():
    assert read(a_message(distance=0.0, has_distance=True)).distance_m == 0.0


@pytest.mark.parametrize('message, problem', [
    (a_message(distance=0.0), 'distance: 0 counts as not given where has_distance is false'),
    (RouteProgress(route_id='home', distance=1.0), 'header.stamp: is 0; it must be set'),
    (a_message(route_id='x' * 257), 'is too long; it must have at most 256 characters')])
def test_what_cannot_be_read_says_what_it_is(message, problem):
    event = progress_event(message, 'look at the clocks')
    assert isinstance(event, ProgressUnreadable)
    assert problem in str(event.error) and event.error.problems[-1] == 'look at the clocks'


# Diagnostics

def a_supervisor():
    supervisor = Supervisor(VEHICLE, Settings(route_progress_timeout_s=8.0))
    supervisor.step(NOW_NS, RouteArrived(Mission('home', (steady_leg(600.0),))))
    return supervisor


def told(supervisor, at_s, **fields):
    """Take a position in; return level and message of the diagnostics."""
    now_ns = NOW_NS + round(at_s * NS_PER_S)
    supervisor.step(now_ns, ProgressArrived(Progress(**{
        'distance_m': 1000.0, 'stamp_ns': now_ns, 'route_id': 'home', **fields})))
    return said(supervisor, now_ns)


def said(supervisor, now_ns):
    status, = (status for status in planner_diagnostics(supervisor.state, now_ns)
               if status.name == 'route progress')
    return status.level, status.message


def test_a_place_says_how_late_the_vehicle_is_and_one_that_is_too_old_is_a_warning():
    supervisor = a_supervisor()
    assert told(supervisor, 110.5)[1].endswith('1:00 min late')
    assert said(supervisor, NOW_NS + round(118.5 * NS_PER_S))[0] == DiagnosticStatus.OK
    assert said(supervisor, NOW_NS + round(119.0 * NS_PER_S)) == (
        DiagnosticStatus.WARN, 'The latest valid route_progress is 8.500 s old; at most 8 s are '
        'allowed: the planner continues by time from there.')


def test_a_refused_place_is_a_warning():
    supervisor = a_supervisor()
    assert told(supervisor, 50.0, route_id='work') == (
        DiagnosticStatus.WARN, "route_progress refused: route_id: 'work' is not the current route, "
        "'home'. The planner follows the stamp of route_plan.")
    assert told(supervisor, 51.0)[0] == DiagnosticStatus.OK
    assert told(supervisor, 52.0, route_id='work')[0] == DiagnosticStatus.WARN
