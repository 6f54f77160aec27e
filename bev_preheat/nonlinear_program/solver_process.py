# SPDX-License-Identifier: Apache-2.0
"""
Solves the nonlinear program in a separate process, which may be killed at any time.

`SolverProcess` is the asking side. It never waits: each call of `poll` exchanges over a socket whatever is
possible at the moment. It does not load CasADi. The process behind it (see `worker`) starts on request, or else
with the first question, and stays for the next.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import os
import pickle
import signal
import socket
import struct
import subprocess
import sys
from time import monotonic
from typing import Any

from bev_preheat.planning.plan import Optimum, Plan
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import Route
from bev_preheat.vehicle import Vehicle

# Any pickled object: a Vehicle, READY, or an object of the classes below.
Thing = Any

# Loading Python, NumPy and CasADi takes a second, or a minute at the lowest priority on a busy computer; beyond
# this limit something is wrong.
SOLVER_START_LIMIT_S = 180.0
# Longest time for a killed process to disappear [s].
END_LIMIT_S = 2.0
# Lower the priority before the first import, because importing keeps a core busy for a while.
PROGRAM = ('import os; os.nice({niceness}); from bev_preheat.nonlinear_program.asking_process import end_with; '
           'end_with({parent}); from bev_preheat.nonlinear_program.worker import serve; '
           'serve({descriptor}, {niceness})')
# The lowest priority: solving uses only idle computing time.
MOST_NICE = 19
# Sent first by a process that waits for questions.
READY = 'ready'
# Precedes each pickled object: its length in bytes.
HEADER = struct.Struct('!Q')
CHUNK_BYTES = 1 << 16


@dataclass(frozen=True)
class Question:
    """
    A situation: the route from now on, the battery's state at its start, and the goal.

    `method` is the name of a planning method whose plan is also requested; '': none.
    `model_factors` correct vehicle and route, in the order of PreheatPlan.msg; (): no correction.
    """

    route: Route
    state: BatteryState
    goal: Goal
    method: str = ''
    model_factors: tuple[float, ...] = ()


@dataclass(frozen=True)
class SolverAnswer:
    """The Optimum of a question, and the plan of its method; None: none was asked for."""

    optimum: Optimum
    method_plan: Plan | None


@dataclass(frozen=True)
class Failure:
    """The reason for a missing solution, and the time spent [s]."""

    explanation: str
    elapsed_s: float


def framed(thing: Thing) -> bytes:
    """Return the encoding of an object on the socket."""
    pickled = pickle.dumps(thing)
    return HEADER.pack(len(pickled)) + pickled


def unframed(received: bytearray) -> Thing:
    """Take the first object from a bytearray; None if it is incomplete."""
    if len(received) < HEADER.size:
        return None
    end = HEADER.size + HEADER.unpack_from(received)[0]
    if len(received) < end:
        return None
    thing = pickle.loads(received[HEADER.size:end])
    del received[:end]
    return thing


class SolverProcess:
    """Asks for one solution at a time, for one vehicle; no method waits, raises, or leaves a process behind."""

    _process: subprocess.Popen[bytes] | None
    _socket: socket.socket
    _question: Question | None
    _time_limit_s: float | None
    _start_problem: str | None

    def __init__(self, vehicle: Vehicle, start_limit_s: float = SOLVER_START_LIMIT_S,
                 niceness: int = MOST_NICE) -> None:
        """Do not start yet; times in seconds, `niceness` 0 ... 19 below this process's priority."""
        self._vehicle, self._niceness = vehicle, niceness
        self._start_limit_s = start_limit_s
        self._process = None
        self._killed: list[subprocess.Popen[bytes]] = []
        self._forget()

    @property
    def is_busy(self) -> bool:
        """Whether a question has no answer yet."""
        return self._time_limit_s is not None

    @property
    def is_solving(self) -> bool:
        """Whether the process is working on a question; not yet while it starts."""
        return self._solves

    @property
    def is_starting(self) -> bool:
        """Whether the process is starting."""
        return self._process is not None and not self._is_ready

    @property
    def process_id(self) -> int | None:
        """Id of the solver's process, or None."""
        return self._process.pid if self._process else None

    def start(self) -> None:
        """Start the process unless it runs; the answer to the next question reports any problem."""
        if self._process is not None and self._process.poll() is not None:
            self._kill()
        if self._process is None:
            self._start()

    def ask(self, question: Question, time_limit_s: float) -> None:
        """Ask a Question, to be answered `time_limit_s` [s] after the start; drop the question being solved."""
        if self._solves or (self._process is not None and self._process.poll() is not None):
            self._kill()
        self._question, self._time_limit_s = question, time_limit_s
        if self._process is None:
            self._start()
        elif self._is_ready:
            self._hand_over()

    def poll(self) -> SolverAnswer | Failure | None:
        """Return a SolverAnswer or a Failure, also of an idle process, or None; do not wait."""
        self._killed = [process for process in self._killed if process.poll() is None]
        if self._process is None:
            if self._start_problem is None:
                return None
            failure = Failure(self._start_problem, 0.0)
            self._forget()
            return failure
        for message in self._exchange():
            if isinstance(message, (SolverAnswer, Failure)):
                self._question = self._time_limit_s = None
                self._solves = False
                return message
            self._is_ready = True
            if self._question is not None:
                self._hand_over()
        return self._loss(self._process)

    def close(self) -> None:
        """End the process, and wait until it is gone."""
        self._kill()
        for process in self._killed:
            try:
                process.wait(END_LIMIT_S)
            except subprocess.TimeoutExpired:
                pass  # exits once the kernel releases it

    def _forget(self) -> None:
        self._question = self._time_limit_s = self._start_problem = None
        self._is_ready = self._solves = False
        self._to_send, self._received = bytearray(), bytearray()
        self._since_s = monotonic()

    def _start(self) -> None:
        ours, theirs = socket.socketpair()
        # This process's modules, and one thread, so that it uses one core at most.
        environment = dict(
            os.environ, PYTHONSAFEPATH='1',
            PYTHONPATH=os.pathsep.join(path or os.getcwd() for path in sys.path),
            OMP_NUM_THREADS='1', OPENBLAS_NUM_THREADS='1')
        with theirs:
            try:
                self._process = subprocess.Popen(
                    [sys.executable, '-c', PROGRAM.format(
                        descriptor=theirs.fileno(), niceness=self._niceness, parent=os.getpid())],
                    stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, env=environment,
                    pass_fds=[theirs.fileno()],
                    # Ctrl-C in a terminal reaches the asking process, which then ends this one.
                    start_new_session=True)
            except OSError as error:
                ours.close()
                self._start_problem = f'the solver process cannot be started: {error}'
                return
        ours.setblocking(False)
        self._socket = ours
        self._since_s = monotonic()
        self._to_send += framed(self._vehicle)

    def _kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._socket.close()
            self._killed.append(self._process)
            self._process = None
        self._forget()

    def _hand_over(self) -> None:
        self._to_send += framed(self._question)
        self._question, self._solves = None, True
        self._since_s = monotonic()
        self._send()

    def _exchange(self) -> Iterator[Thing]:
        self._send()
        try:
            while chunk := self._socket.recv(CHUNK_BYTES):
                self._received += chunk
        except OSError:
            pass  # nothing more for now, or ever; _loss() checks whether the process lives
        while (message := unframed(self._received)) is not None:
            yield message

    def _send(self) -> None:
        try:
            while self._to_send:
                del self._to_send[:self._socket.send(self._to_send[:CHUNK_BYTES])]
        except OSError:
            pass

    def _loss(self, process: subprocess.Popen[bytes]) -> Failure | None:
        """Return a Failure if the process has ended or exceeded its time limit."""
        status, elapsed_s = process.poll(), monotonic() - self._since_s
        if status is not None:
            explanation = f'the solver process ended with {_ending(status)}'
        elif not self._is_ready and elapsed_s > self._start_limit_s:
            explanation = f'the solver process did not start within {self._start_limit_s:g} s'
        elif (self._solves and self._time_limit_s is not None
              and elapsed_s > self._time_limit_s):
            explanation = f'no solution within the time limit of {self._time_limit_s:g} s'
        else:
            return None
        self._kill()
        return Failure(explanation, elapsed_s)


def _ending(status: int) -> str:
    if status >= 0:
        return f'exit status {status}'
    try:
        return signal.Signals(-status).name
    except ValueError:
        return f'signal {-status}'
