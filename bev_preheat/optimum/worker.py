# SPDX-License-Identifier: Apache-2.0
"""
Solves the nonlinear program in a process of its own, which may be killed at any time.

`SolverProcess` is the asking side. It never waits: what can be sent or received at the moment goes
over a socket whenever `poll` is called. It loads no CasADi. The process behind it runs `serve`: it
starts with the first question, stays for the next, takes only computing time that nobody else
wants, and ends by itself when the asking process is gone.
"""

from dataclasses import dataclass
import os
from pathlib import Path
import pickle
import queue
import signal
import socket
import struct
import subprocess
import sys
import threading
from time import monotonic
from typing import Optional

from bev_preheat.errors import InvalidInput
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import Route
from bev_preheat.vehicle.corrections import corrected_vehicle, Corrections

# Loading Python, NumPy and CasADi takes a second; where it takes this long something is wrong.
START_LIMIT_S = 60.0
# How long a killed process may take to be gone [s].
END_LIMIT_S = 2.0
# Polite before the first import, as importing takes most of a core for a while.
PROGRAM = 'import os; os.nice(19); from bev_preheat.optimum.worker import serve; serve({})'
LINUX_PRIORITIES = {
    # Where memory runs short, the kernel is to take this process and leave the planner.
    '/proc/self/oom_score_adj': '1000',
    # Where sessions share the computer evenly, os.nice() counts within this one only.
    '/proc/self/autogroup': '19',
}
READY = 'ready'
# Before each pickled object: its length in bytes.
HEADER = struct.Struct('!Q')
CHUNK_BYTES = 1 << 16


@dataclass(frozen=True)
class Question:
    """
    A situation: the route from now on, the battery's state at its start, and the goal.

    `method` is one of planning.planner.METHODS, whose plan is wanted too; '': none is.
    `model_factors` correct vehicle and route, in the order of PreheatPlan.msg; (): as they are.
    """

    route: Route
    state: BatteryState
    goal: Goal
    method: str = ''
    model_factors: tuple = ()


@dataclass(frozen=True)
class Solution:
    """
    What the solver found; the fields are those of `optimum.solve.Optimum`.

    `is_optimal`: `optimal_plan` keeps all constraints and is the optimum; otherwise it is the best
    that can be done, and `infeasible` names what cannot be kept. `method_plan` is the plan of the
    question's method.
    """

    optimal_plan: Plan
    solver_status: str
    is_optimal: bool
    infeasible: tuple
    solve_time_s: float
    method_plan: Optional[Plan]


@dataclass(frozen=True)
class Failure:
    """Why there is no solution, and how long it was tried [s]."""

    explanation: str
    elapsed_s: float


class SolverProcess:
    """
    Asks for one solution at a time; no method waits, raises, or leaves a process behind.

    The process knows one vehicle: another needs another SolverProcess.
    """

    def __init__(self, vehicle, start_limit_s=START_LIMIT_S):
        """Start nothing yet; `start_limit_s` [s] is how long the process may take to start."""
        self._vehicle = vehicle
        self._start_limit_s = start_limit_s
        self._process = None
        self._killed = []
        self._forget()

    @property
    def is_busy(self):
        """Whether a question has no answer yet."""
        return self._time_limit_s is not None

    @property
    def is_solving(self):
        """Whether the process has a question; while it starts, it has none yet."""
        return self._solves

    @property
    def process_id(self):
        """Id of the solver's process; None where there is none."""
        return self._process.pid if self._process else None

    def ask(self, question, time_limit_s):
        """
        Ask a Question, to be answered within `time_limit_s` [s] after the process has started.

        A question that is being solved is given up.
        """
        if self._solves or self._process is not None and self._process.poll() is not None:
            self._kill()
        self._question, self._time_limit_s = question, time_limit_s
        if self._process is None:
            self._start()
        elif self._is_ready:
            self._hand_over()

    def poll(self):
        """
        Exchange what can be exchanged; return a Solution or a Failure when there is one, or None.

        A Failure without a question tells that the process ended while it had nothing to do.
        """
        self._killed = [process for process in self._killed if process.poll() is None]
        if self._process is None:
            if self._start_problem is None:
                return None
            failure = Failure(self._start_problem, 0.0)
            self._forget()
            return failure
        for message in self._exchange():
            if message != READY:
                self._question = self._time_limit_s = None
                self._solves = False
                return message
            self._is_ready = True
            if self._question is not None:
                self._hand_over()
        return self._loss()

    def close(self):
        """End the process, and wait until it is gone."""
        self._kill()
        for process in self._killed:
            try:
                process.wait(END_LIMIT_S)
            except subprocess.TimeoutExpired:
                pass  # the kernel holds it; it goes as soon as it is let go

    def _forget(self):
        self._question = self._time_limit_s = self._start_problem = None
        self._is_ready = self._solves = False
        self._to_send, self._received = bytearray(), bytearray()
        self._since_s = monotonic()

    def _start(self):
        ours, theirs = socket.socketpair()
        # The modules of this process, and one thread, so that it takes one core at most.
        environment = dict(
            os.environ, PYTHONSAFEPATH='1',
            PYTHONPATH=os.pathsep.join(path or os.getcwd() for path in sys.path),
            OMP_NUM_THREADS='1', OPENBLAS_NUM_THREADS='1')
        with theirs:
            try:
                self._process = subprocess.Popen(
                    [sys.executable, '-c', PROGRAM.format(theirs.fileno())],
                    stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, env=environment,
                    pass_fds=[theirs.fileno()],
                    # Ctrl-C in a terminal is for the asking process, which then ends this one.
                    start_new_session=True)
            except OSError as error:
                ours.close()
                self._start_problem = f'the solver process cannot be started: {error}'
                return
        ours.setblocking(False)
        self._socket = ours
        self._since_s = monotonic()
        self._to_send += _framed(self._vehicle)

    def _kill(self):
        if self._process is not None:
            self._process.kill()
            self._socket.close()
            self._killed.append(self._process)
            self._process = None
        self._forget()

    def _hand_over(self):
        self._to_send += _framed(self._question)
        self._question, self._solves = None, True
        self._since_s = monotonic()
        self._send()

    def _exchange(self):
        self._send()
        try:
            while chunk := self._socket.recv(CHUNK_BYTES):
                self._received += chunk
        except OSError:
            pass  # nothing more for now, or for ever; whether the process lives says _loss()
        while (message := _unframed(self._received)) is not None:
            yield message

    def _send(self):
        try:
            while self._to_send:
                del self._to_send[:self._socket.send(self._to_send[:CHUNK_BYTES])]
        except OSError:
            pass

    def _loss(self):
        """Return a Failure where the process has ended, or has had its time."""
        status, elapsed_s = self._process.poll(), monotonic() - self._since_s
        if status is not None:
            explanation = f'the solver process ended with {_ending(status)}'
        elif not self._is_ready and elapsed_s > self._start_limit_s:
            explanation = f'the solver process did not start within {self._start_limit_s:g} s'
        elif self._solves and elapsed_s > self._time_limit_s:
            explanation = f'no solution within the time limit of {self._time_limit_s:g} s'
        else:
            return None
        self._kill()
        return Failure(explanation, elapsed_s)


def _ending(status):
    if status >= 0:
        return f'exit status {status}'
    try:
        return signal.Signals(-status).name
    except ValueError:
        return f'signal {-status}'


def _framed(thing):
    pickled = pickle.dumps(thing)
    return HEADER.pack(len(pickled)) + pickled


def _unframed(received):
    """Take the first object from the bytes received; None where it is not there as a whole."""
    if len(received) < HEADER.size:
        return None
    end = HEADER.size + HEADER.unpack_from(received)[0]
    if len(received) < end:
        return None
    thing = pickle.loads(received[HEADER.size:end])
    del received[:end]
    return thing


def serve(descriptor):
    """Answer the questions that come over a socket (its file descriptor) until it closes."""
    for path, value in LINUX_PRIORITIES.items():
        try:
            Path(path).write_text(value, encoding='ascii')
        except OSError:
            pass  # another system, or a kernel without it
    connection = socket.socket(fileno=descriptor)
    messages = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(connection, messages), daemon=True).start()
    vehicle = messages.get()
    try:
        _load_solver()
    except Exception:  # noqa: B902  the first question meets it again, and its answer tells
        pass
    answer = READY
    while True:
        try:
            connection.sendall(_framed(answer))
        except OSError:
            return
        answer = _answer(vehicle, messages.get())


def _receive(connection, messages):
    # In a thread: CasADi lets other threads run while it solves, so the end is noticed at once.
    received = bytearray()
    try:
        while chunk := connection.recv(CHUNK_BYTES):
            received += chunk
            while (message := _unframed(received)) is not None:
                messages.put(message)
    finally:
        os._exit(0)


def _load_solver():
    from bev_preheat.optimum.solve import solve_optimum, SUCCESS
    return solve_optimum, SUCCESS


def _answer(vehicle, question):
    """Return the Solution or the Failure of a Question."""
    started_s = monotonic()
    route, factors = question.route, question.model_factors
    if factors:
        vehicle = corrected_vehicle(vehicle, Corrections(*factors[:-1]))
        route = route.with_propulsion(factors[-1])
    situation = vehicle, route, question.state, question.goal
    try:
        solve_optimum, success = _load_solver()
        method_plan = plan_preheating(*situation, question.method) if question.method else None
        optimum = solve_optimum(*situation)
    except InvalidInput as error:
        return Failure(str(error), monotonic() - started_s)
    except Exception as error:  # noqa: B902  whatever it is, the next question may go well
        return Failure(f'{type(error).__name__}: {error}', monotonic() - started_s)
    return Solution(
        optimal_plan=optimum.plan,
        solver_status=optimum.solver_status,
        is_optimal=optimum.solver_status == success,
        infeasible=optimum.infeasible,
        solve_time_s=optimum.solve_time_s,
        method_plan=method_plan)
