# SPDX-License-Identifier: Apache-2.0
"""`dashboard` beside real planners, over DDS and HTTP, without a browser."""

import asyncio
from contextlib import contextmanager
import json
import re
import signal
import socket
import time
from urllib.request import Request, urlopen

from node_bench import repeating
from planner_car import LATCHED, PlannerCar
import pytest
from sensor_msgs.msg import BatteryState
from spinning import spun_node
from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect
from waiting import poll_until

from bev_preheat.control.inputs import Leg, Mission
from bev_preheat.messages.route_plan import route_plan_message
from bev_preheat.monitoring import planners
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import HeatSourceCommand, HvchCommand, PreheatPlan, RoutePlan

LIMIT_S = 120.0
EVIL = '<img src=x onerror=alert(1)></script>"\''


def page_of(process):
    found = poll_until(lambda: re.search(r'http://(\S+:\d+)/', process.output()), 'the address of the page')
    return found.group(1)


class Tab:
    """The latest state of a tab, filled by its own connection whenever it is asked."""

    def __init__(self, host):
        self.host, self.planners, self.view, self.plan = host, [], {}, {}

    def watch(self, planner, condition, what):
        """Return the first view of a planner for which condition(this tab) holds."""
        async def follow():
            connection = await websocket_connect(HTTPRequest(
                f'ws://{self.host}/tab', headers={'Origin': f'http://{self.host}'}))
            end_s = time.monotonic() + LIMIT_S
            await connection.write_message(json.dumps({'planner': planner}))
            self.view = {}
            while True:
                text = await asyncio.wait_for(connection.read_message(), LIMIT_S)
                values = json.loads(text, parse_constant=lambda name: pytest.fail(name))
                for key in ('planners', 'view', 'plan'):
                    setattr(self, key, values.get(key, getattr(self, key)))
                if (self.view or not planner) and condition(self):
                    connection.close()
                    return
                assert time.monotonic() < end_s, f'{what}: {self.planners} {self.view}'
        asyncio.run(follow())
        return self.view


def ask(host, **values):
    request = Request(f'http://{host}/ask', json.dumps(values).encode(), {
        'Origin': f'http://{host}', 'Content-Type': 'application/json'})
    with urlopen(request, timeout=LIMIT_S) as answer:
        return json.loads(answer.read())


@contextmanager
def driving(bench, namespace='', temperature_c=-7.0, route_id='trip', **route):
    """Publish a route and battery states in real time."""
    car = PlannerCar(bench, namespace, commands_alone=True)
    message = route_plan_message(Mission(route_id, (Leg(
        load_route('reference', load_vehicle('reference').defaults), car.now_ns, target_temperature_c=25.0,
        minimum_arrival_soc=0.3),)))
    for name, value in route.items():
        setattr(message, name, value)
    car.give(message)
    with car.feeding(lambda: car.state(
            temperature=temperature_c, percentage=0.9, voltage=400.0, current=-50.0), 0.3):
        yield


def test_planners_come_answer_go_and_come_back(bench):
    dashboard = bench.start('dashboard', '-p', 'port:=0', '-p', 'controls:=true')
    host = page_of(dashboard)
    tab = Tab(host)
    # No planner at the start.
    tab.watch('', lambda tab: True, 'an empty list')
    assert tab.planners == []
    planner = bench.start('planner')
    other = bench.start('planner', '-r', '__ns:=/car_7', '-p', 'vehicle:=heat_pump_car')
    with driving(bench, route_id=EVIL), driving(bench, '/car_7', temperature_c=3.0):
        # Topics come in any order: the page may hear of the plan before it hears a battery state.
        view = tab.watch('/planner', lambda tab: tab.view['status'] == 'WAITING' and tab.view['regime']
                         and tab.view['temperature'] is not None and tab.view['routeId']
                         and tab.view['reserve'] and tab.view['enabled'] and not tab.view['banner']
                         and len(tab.plan.get('planUnheated', ())) > 2
                         and tab.plan['planUnheated'][0] is not None, 'a plan')
        assert view['temperature'] == -7.0 and view['routeId'] == EVIL and view['reserve'] == 0.3
        assert view['predicted'] == pytest.approx(25.0, abs=1.0)
        # Without heating it arrives colder by the heat of some 2 kWh.
        assert 8.0 < tab.plan['planned'][-1] - tab.plan['planUnheated'][-1] < 30.0
        tab.watch('/car_7/planner', lambda tab: tab.view['temperature'] == 3.0 and not tab.view['banner']
                  and len(tab.view['sources']) == 4, 'the other one')
        assert [each['name'] for each in tab.planners] == ['/car_7/planner', '/planner']
        assert_it_answers(host, tab)
        planner.send_signal(signal.SIGKILL)
        view = tab.watch('/planner', lambda tab: 'command' in tab.view['late'] and tab.view['banner']
                         and tab.view['banner']['level'] == 'error'
                         and tab.planners[-1]['problem'] in ('silent', 'gone'), 'a banner')
        assert (tab.planners[0]['name'], tab.planners[0]['problem']) == ('/car_7/planner', '')
        assert view['temperature'] == -7.0
        bench.start('planner')
        tab.watch('/planner', lambda tab: not tab.view['banner'] and tab.view['status'] == 'WAITING', 'it is back')
        assert ask(host, planner='/planner', kind='enable')['isAccepted']
        other.send_signal(signal.SIGTERM)
        tab.watch('/car_7/planner', lambda tab: tab.planners[0]['problem'] == 'gone', 'the other planner has left')
        bench.start('planner', '-r', '__ns:=/car_7')
        tab.watch('/car_7/planner', lambda tab: not tab.view['banner'] and tab.view['power'] is not None
                  and not tab.view['sources'], 'another car')
    assert 'WARN' not in dashboard.output() and 'ERROR' not in dashboard.output()


def assert_it_answers(host, tab):
    assert ask(host, planner='/planner', kind='disable') == {
        'isAccepted': True, 'text': 'Preheating is switched off.'}
    tab.watch('/planner', lambda tab: tab.view['status'] == 'DISABLED' and tab.view['enabled'] is False, 'off')
    refused = ask(host, planner='/planner', kind='prepare', minutes=30, target=20)
    assert not refused['isAccepted'] and 'refused: Preheating is switched off' in refused['text']
    assert ask(host, planner='/planner', kind='enable')['isAccepted']
    accepted = ask(host, planner='/planner', kind='prepare', minutes=240, target=12)
    assert accepted['isAccepted']
    assert 'Preparing the battery' in accepted['text'] and '12.0 degC' in accepted['text']
    view = tab.watch('/planner', lambda tab: tab.view['goal'] and tab.view['target'] == 12.0, 'the goal')
    assert view['goal'].startswith(('ready in 3:5', 'ready in 4:00'))
    assert ask(host, planner='/planner', kind='cancel')['isAccepted']
    tab.watch('/planner', lambda tab: 'cancelled' in (tab.view['outcome'] or ''), 'its end')
    assert ask(host, planner='/planner', kind='cancel') == {
        'isAccepted': False, 'text': 'There is no preparation to cancel.'}
    skipped = ask(host, planner='/planner', kind='skip')
    assert not skipped['isAccepted'] and 'no departures' in skipped['text']


def test_whatever_a_publisher_sends_is_no_end(bench):
    """A foreign node with a planner's topics: NaN, absurd sizes and stamps, a million segments."""
    dashboard = bench.start('dashboard', '-p', 'port:=0')
    tab = Tab(page_of(dashboard))
    plans = bench.publisher(PreheatPlan, 'preheat_plan', LATCHED)
    commands = bench.publisher(HvchCommand, 'hvch_command')
    bench.record(BatteryState, 'battery_state', 1)
    bench.record(RoutePlan, 'route_plan', LATCHED)
    nan = float('nan')
    bad = PreheatPlan(status=250, explanation=EVIL * 10_000, route_id=EVIL, predicted_arrival_temperature=nan,
                      heating_planned=True, time=[0.0, nan, 5.0], battery_temperature=[nan] * 3, soc=[1e300] * 3,
                      hvch_power=[float('inf')] * 2)
    command = HvchCommand(battery_heating_power=nan, reason=99)
    with repeating(lambda: (plans.publish(bad), commands.publish(command)), 0.2):
        with driving(bench, temperature_c=nan, segment_duration=[1.0] * 1_000_000):
            view = tab.watch('/tester', lambda tab: tab.view['status'] and tab.view['ages']['battery'] is not None
                             and 'planTime' in tab.plan, 'the foreign node')
    assert view['status'] == 'STATUS_250' and view['power'] is view['predicted'] is view['temperature'] is None
    assert tab.plan['planTime'] == [] and len(view['sentence']) < 2100
    assert dashboard.exit_status is None and 'ERROR' not in dashboard.output()


def test_plans_of_two_planners_on_one_topic_are_not_mixed(domain_id, monkeypatch):
    monkeypatch.setattr(planners, 'RIVALS_AFTER_S', 0.5)
    with spun_node('page', domain_id) as page, spun_node('planner', domain_id) as first:
        followed, ready = planners.Planners(page), []

        def publisher_of(node):
            node.create_subscription(BatteryState, 'battery_state', ready.append, 1)
            return node.create_publisher(PreheatPlan, 'preheat_plan', LATCHED), node.create_publisher(
                HvchCommand, 'hvch_command', 1)

        def shown(publishers, route_id):
            followed.look()
            for publisher, message in zip(publishers, (PreheatPlan(route_id=route_id), HvchCommand())):
                message.header.stamp = page.get_clock().now().to_msg()
                publisher.publish(message)
            return followed.boards.get('/planner')

        own = publisher_of(first)
        board = poll_until(lambda: (found := shown(own, 'own')) and found.plan and found, 'the first plan')
        assert board.plan.message.route_id == 'own' and not board.around.rivals
        with spun_node('planner', domain_id) as second:
            others = publisher_of(second)
            poll_until(lambda: shown(own, 'own').around.rivals, 'the second planner')
            board.plan = None
            # A reliable publisher has delivered once the third of its messages is due.
            for _ in range(3):
                shown(own, 'own'), shown(others, 'other')
                time.sleep(0.2)
            assert board.plan is None
            banner = board.banner(time.monotonic())
            assert banner.text.startswith('/preheat_plan has 2 publishers, /planner, /planner; it must have one')
        poll_until(lambda: shown(own, 'own').plan is not None, 'the planner that is left')
        assert not board.around.rivals and board.plan.message.route_id == 'own'


def test_topics_that_are_discovered_later_than_the_planner_are_followed(bench):
    tab = Tab(page_of(bench.start('dashboard', '-p', 'port:=0')))
    bench.publisher(PreheatPlan, 'preheat_plan', LATCHED)
    commands = bench.publisher(HvchCommand, 'hvch_command')
    bench.record(BatteryState, 'battery_state', 1)

    def command(publisher, message):
        message.header.stamp = bench.node.get_clock().now().to_msg()
        publisher.publish(message)

    with repeating(lambda: command(commands, HvchCommand()), 0.2):
        tab.watch('/tester', lambda tab: tab.view['power'] == 0.0, 'a planner')
        sources = bench.publisher(HeatSourceCommand, 'heat_source_command')
        with repeating(lambda: command(sources, HeatSourceCommand(name='pump', battery_heating_power=900.0)), 0.2):
            tab.watch('/tester', lambda tab: ['pump', 900.0] in tab.view['sources'], 'its heat source')


def test_a_taken_port_and_a_bad_parameter_are_one_line(refusal):
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        for argument, told in (
                (f'port:={port}', f'port: 127.0.0.1:{port} cannot be used: Address already in use'),
                ('port:=70000', 'port: 70000 is not allowed; it must be 0 ... 65535'),
                ('address:=0.0.0.0', 'address: 0.0.0.0 is not allowed without a token'),
                ('token:=1234567890123456', 'token: is not a text'),
                ('token:=short-secret', 'token: has 12 characters')):
            line = refusal('dashboard', '--ros-args', '-p', argument)
            assert told in line
            assert '1234567890123456' not in line and 'short-secret' not in line


def test_the_token_is_neither_in_ros_nor_in_the_log_and_it_publishes_nothing(bench):
    token = 'correct-horse-battery'
    dashboard = bench.start('dashboard', '-p', 'port:=0', '-p', f'token:={token}', '-p', 'control:=true')
    host = page_of(dashboard)
    assert "parameter 'control' is unknown and ignored; did you mean 'controls'?" in dashboard.output()
    with pytest.raises(OSError, match='401'):
        urlopen(f'http://{host}/?token={token[:-1]}', timeout=LIMIT_S)
    poll_until(lambda: 'dashboard' in bench.node.get_node_names(), 'the node')
    services = dict(bench.node.get_service_names_and_types_by_node('dashboard', '/'))
    assert not any('parameter' in name for name in services)
    assert token not in dashboard.output() and token[:-1] not in dashboard.output()
    topics = {name for name, _ in bench.node.get_publisher_names_and_types_by_node('dashboard', '/')}
    assert topics <= {'/rosout', '/parameter_events'}
