# SPDX-License-Identifier: Apache-2.0
"""The main loop: its resources, its endings, and the exceptions that it passes on."""

import os
import signal
import subprocess
import sys

from ament_index_python.packages import get_package_prefix
import pytest
from waiting import poll_until, TIME_LIMIT_S

PROGRAM = """
import gc
import sys

from rclpy.node import Node
from rclpy.task import Future

from bev_preheat.nodes.process import run_node


class Ticking(Node):
    def __init__(self):
        super().__init__('ticking', enable_rosout=False)
        self.finished, self.ticks, self.counts = Future(), 0, []
        self.create_timer(0.001, self.tick)

    def tick(self):
        self.ticks += 1
        if self.ticks in (200, 1200):
            gc.collect()
            self.counts.append(sum(callable(item) for item in gc.get_objects()))
        {at_each_tick}

    def last_words(self):
        print('last words', *self.counts)


sys.exit(run_node(Ticking))
"""


def run(at_each_tick, domain_id):
    return subprocess.run(
        [sys.executable, '-c', PROGRAM.format(at_each_tick=at_each_tick)], text=True, timeout=60,
        capture_output=True, env={**os.environ, 'ROS_DOMAIN_ID': str(domain_id)})


def test_a_callback_leaves_nothing_behind(domain_id):
    done = run('self.ticks < 1200 or self.finished.set_result(None)', domain_id)
    assert done.returncode == 0, done.stderr
    before, after = map(int, done.stdout.split()[2:])
    # A thousand callbacks lie between them.
    assert after - before < 20


def test_what_a_callback_raises_ends_the_process_after_its_last_words(domain_id):
    done = run('raise LookupError("told")', domain_id)
    assert done.returncode == 1
    assert 'last words' in done.stdout
    assert 'LookupError: told' in done.stderr


LOADS = """
import sys
import time

from rclpy.node import Node
from rclpy.task import Future

from bev_preheat.nodes.process import join_graph, run_node


class Slow(Node):
    def __init__(self):
        sys.stdin.readline()
        super().__init__('slow')
        self.finished = Future()


loading_node = join_graph('slow')
print('joined', flush=True)
sys.exit(run_node(Slow, None, loading_node))
"""


def test_a_process_is_found_before_its_node_is_made_and_only_as_that_node_afterwards(node, domain_id):
    def await_names(*names):
        poll_until(lambda: set(node.get_node_names()) == {node.get_name(), *names}, f'the names {names}')

    process = subprocess.Popen([sys.executable, '-c', LOADS, '--ros-args', '-r', '__ns:=/car'], text=True,
                               stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                               env={**os.environ, 'ROS_DOMAIN_ID': str(domain_id)})
    try:
        assert process.stdout.readline() == 'joined\n'
        await_names('_slow_loads')
        process.stdin.write('\n')
        process.stdin.flush()
        await_names('slow')
        assert ('slow', '/car') in node.get_node_names_and_namespaces()
        process.terminate()
        assert process.wait(TIME_LIMIT_S) == 0
    finally:
        process.kill()


@pytest.mark.parametrize('value, text', [
    ('abc', 'ROS_DOMAIN_ID'),
    pytest.param('233', 'ROS_DOMAIN_ID: 233 is not allowed; it must be 0 ... 232', marks=pytest.mark.deep)])
def test_a_domain_that_no_participant_can_have_is_refused_in_one_line(value, text):
    executable = os.path.join(get_package_prefix('bev_preheat'), 'lib', 'bev_preheat', 'planner')
    done = subprocess.run([executable], text=True, capture_output=True, timeout=60,
                          env={**os.environ, 'ROS_DOMAIN_ID': value})
    (line,) = done.stderr.splitlines()
    assert (done.returncode, done.stdout) == (2, '')
    assert line.startswith('planner: error: ') and text in line


HANGING_LOAD = """
import sys
import time

from bev_preheat import nodes


def load(module):
    print('loads', flush=True)
    time.sleep(60.0)


nodes.import_module = load
nodes.{name}()
"""


# All but the planner are loaded in one way.
@pytest.mark.parametrize('name', ['planner', 'nlp_checker'])
def test_ctrl_c_while_a_node_is_loaded_ends_it_without_a_traceback(name, domain_id):
    process = subprocess.Popen(
        [sys.executable, '-c', HANGING_LOAD.format(name=name)], text=True, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, env={**os.environ, 'ROS_DOMAIN_ID': str(domain_id)})
    try:
        assert process.stdout.readline() == 'loads\n'
        process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=TIME_LIMIT_S)
    finally:
        process.kill()
    assert (process.returncode, told) == (-signal.SIGINT, '')
