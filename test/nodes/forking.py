# SPDX-License-Identifier: Apache-2.0
"""
Runs the installed executables as processes that are forked where all their modules are loaded already.

Loading takes most of a second of processor time, and starting takes a tenth of that. The processes run the same
files as `ros2 run`, from their first line. `python3 forking.py` is the process that forks: a line on its input is
a request, a line on its output the answer.
"""

import json
import math
import os
from pathlib import Path
import runpy
import signal
import subprocess
import sys
import time

POLL_S = 0.005
MODULES = ('nodes.vehicle_simulator_node', *(f'nodes.{name}_node' for name in (
    'planner', 'nlp_checker', 'charger_adviser', 'route_publisher', 'heater_controller', 'bus_gateway')))
# The messages that nearly every node has; their type support is loaded when the first publisher is made.
MESSAGES = (('bev_preheat_msgs.msg', ('HvchCommand', 'HvchStatus', 'PreheatPlan', 'RoutePlan', 'RouteProgress')),
            ('sensor_msgs.msg', ('BatteryState', 'Temperature')), ('diagnostic_msgs.msg', ('DiagnosticArray',)))


class Pool:
    """The process that forks, seen by the tests of this process."""

    def __init__(self):
        """Begin to load; the first start waits for it."""
        self.path = os.environ.get('PYTHONPATH')
        # LTTng, which traces ROS, cancels its threads at the end. A forked process does not have them, and crashes
        # if the memory of their stacks has been freed. This cache keeps it.
        kept = {'GLIBC_TUNABLES': 'glibc.pthread.stack_cache_size=4294967296'}
        # Not in the terminal's session: after Ctrl-C the tests under way end their nodes themselves.
        self._process = subprocess.Popen([sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                         text=True, start_new_session=True, env={**os.environ, **kept})

    def ask(self, **request):
        self._process.stdin.write(json.dumps(request) + '\n')
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def start(self, arguments, log_file, environment):
        """Fork a process that runs `arguments`, a file of Python and its arguments; return a ForkedProcess."""
        # The process may still be on its way to its first line when its output is read.
        Path(log_file).write_bytes(b'')
        return ForkedProcess(self, self.ask(
            arguments=list(map(str, arguments)), log_file=str(log_file), environment=environment,
            folder=os.getcwd()))

    def close(self):
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()


class ForkedProcess:
    """A process with the methods of subprocess.Popen."""

    def __init__(self, pool, pid):
        self._pool, self.pid, self.returncode = pool, pid, None

    def poll(self):
        """Return the exit status, None while it runs."""
        if self.returncode is None:
            self.returncode = self._pool.ask(status=self.pid)
        return self.returncode

    def wait(self, timeout=math.inf):
        """Return the exit status; raise subprocess.TimeoutExpired if it is still running."""
        end_s = time.monotonic() + timeout
        while self.poll() is None:
            if time.monotonic() > end_s:
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            time.sleep(POLL_S)
        return self.returncode

    def send_signal(self, number):
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self):
        self.send_signal(signal.SIGTERM)

    def kill(self):
        self.send_signal(signal.SIGKILL)


def load():
    """Load the modules of the executables."""
    for module in MODULES:
        __import__(f'bev_preheat.{module}')
    for module, names in MESSAGES:
        for name in names:
            message_type = getattr(__import__(module, fromlist=names), name)
            message_type.__class__.__import_type_support__()


def serve():
    """Answer requests until the input ends; return a request in the process that was forked for it."""
    for line in sys.stdin:
        request = json.loads(line)
        if 'status' in request:
            pid, status = os.waitpid(request['status'], os.WNOHANG)
            answer = os.waitstatus_to_exitcode(status) if pid else None
        else:
            answer = os.fork()
            if answer == 0:
                return request
        print(json.dumps(answer), flush=True)
    return None


def become(request):
    """Give this process the arguments, environment and output of a request."""
    nothing = os.open(os.devnull, os.O_RDONLY)
    log = os.open(request['log_file'], os.O_WRONLY | os.O_APPEND)
    for source, target in ((nothing, 0), (log, 1), (log, 2)):
        os.dup2(source, target)
    os.environ.clear()
    os.environ.update(request['environment'])
    os.chdir(request['folder'])
    sys.argv = request['arguments']
    sys.path[0] = str(Path(sys.argv[0]).parent)


if __name__ == '__main__':
    load()
    started = serve()
    if started is not None:
        become(started)
        runpy.run_path(sys.argv[0], run_name='__main__')
