# SPDX-License-Identifier: Apache-2.0
"""What the asking process and the solver's process say to each other, and how it is sent."""

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

    # Whatever was pickled: a Vehicle, READY, or one of the classes below.
    Thing = Any

# The first word of a process that waits for questions.
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
    model_factors: tuple[float, ...] = ()


@dataclass(frozen=True)
class Preparation:
    """A route of which questions will come: the program for its number of steps is built."""

    route: Route


@dataclass(frozen=True)
class Prepared:
    """The answer to a Preparation: how many steps its route has; None where it failed."""

    steps: int | None


@dataclass(frozen=True)
class SolverAnswer:
    """
    What was found; the fields are those of `optimum.solve.Optimum`, `solver` names who answered.

    `is_optimal`: `optimal_plan` keeps all constraints and is the optimum; otherwise it is the best
    that can be done, and `infeasible` names what cannot be kept. `method_plan` is the plan of the
    question's method. `programs_built` counts the programs that had to be built for it: those of
    earlier questions with as many steps, and prepared ones, are used again.
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
    """Why there is no solution, and how long it was tried [s]."""

    explanation: str
    elapsed_s: float


def framed(thing: Thing) -> bytes:
    """Return the bytes that stand for an object on the socket."""
    pickled = pickle.dumps(thing)
    return HEADER.pack(len(pickled)) + pickled


def unframed(received: bytearray) -> Thing:
    """Take the first object from a bytearray; None where it is not there as a whole."""
    if len(received) < HEADER.size:
        return None
    end = HEADER.size + HEADER.unpack_from(received)[0]
    if len(received) < end:
        return None
    thing = pickle.loads(received[HEADER.size:end])
    del received[:end]
    return thing
