# SPDX-License-Identifier: Apache-2.0
"""The main loop: what it keeps, what ends it, and what it passes on."""

import os
import subprocess
import sys

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
