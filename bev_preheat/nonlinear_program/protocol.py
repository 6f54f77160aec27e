# SPDX-License-Identifier: Apache-2.0
"""Messages between the asking process and the solver's process, and their encoding."""

from __future__ import annotations

from dataclasses import dataclass
import pickle
import struct
from typing import TYPE_CHECKING

from bev_preheat.planning.plan import Plan
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import Route

if TYPE_CHECKING:
    from typing import Any

    # Any pickled object: a Vehicle, READY, or one of the classes below.
    Thing = Any

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
class Preparation:
    """A route about which questions will follow: the program for its number of steps is built."""

    route: Route


@dataclass(frozen=True)
class Prepared:
    """The answer to a Preparation: the number of steps of its route; None if it failed."""

    steps: int | None


@dataclass(frozen=True)
class SolverAnswer:
    """
    The solver's result; the fields are those of `optimum.solve.Optimum`, `solver` names the solver.

    `is_optimal`: `optimal_plan` keeps all constraints and is the optimum; otherwise it is the best possible
    plan, and `infeasible` names the constraints that cannot be kept. `method_plan` is the plan of the
    question's method. `programs_built` counts the programs built for this answer: those of earlier
    questions with as many steps, and prepared ones, are reused.
    """

    optimal_plan: Plan
    solver: str
    solver_status: str
    is_optimal: bool
    infeasible: tuple[str, ...]
    solve_time_s: float
    method_plan: Plan | None
    programs_built: int


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
