# SPDX-License-Identifier: Apache-2.0
"""
The solver's process: answers the questions of a `SolverProcess`.

It uses only idle computing time, and ends with the asking process: through `asking_process` if the kernel supports
it, else by itself.
"""

from __future__ import annotations

import os
from pathlib import Path
import queue
import socket
import threading
from time import monotonic

from bev_preheat.errors import InvalidInput
from bev_preheat.nonlinear_program.solver_process import (
    CHUNK_BYTES,
    Failure,
    framed,
    Question,
    READY,
    SolverAnswer,
    Thing,
    unframed,
)
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import Vehicle
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections


def serve(descriptor: int, niceness: int) -> None:
    """Answer the questions that come over a socket (its file descriptor) until it closes."""
    _give_way(niceness)
    connection = socket.socket(fileno=descriptor)
    messages: queue.SimpleQueue[Thing] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(connection, messages), daemon=True).start()
    vehicle = messages.get()
    _warm_up(vehicle)
    answer: Thing = READY
    while True:
        try:
            connection.sendall(framed(answer))
        except OSError:
            return
        answer = _answer(vehicle, messages.get())


def _give_way(niceness: int) -> None:
    linux_priorities = {
        # If memory runs short, the kernel should kill this process rather than the planner.
        '/proc/self/oom_score_adj': 1000,
        # If the kernel divides the computer between sessions, os.nice() only counts within this session.
        '/proc/self/autogroup': niceness}
    for path, value in linux_priorities.items():
        try:
            Path(path).write_text(str(value), encoding='ascii')
        except OSError:
            pass  # another system, or a kernel without it


def _receive(connection: socket.socket, messages: queue.SimpleQueue[Thing]) -> None:
    # In a thread: CasADi lets other threads run while it solves, so the end is noticed at once.
    received = bytearray()
    try:
        while chunk := connection.recv(CHUNK_BYTES):
            received += chunk
            while (message := unframed(received)) is not None:
                messages.put(message)
    finally:
        os._exit(0)


def _warm_up(vehicle: Vehicle) -> None:
    """Load the solver and solve the smallest problem, which also loads the solver's library."""
    try:
        from bev_preheat.nonlinear_program.solve import solve_optimum
        battery = vehicle.battery
        temperature_c = sum(battery.temperature_range_c) / 2.0
        parked = make_route({
            'duration_s': [30.0], 'speed_mps': [0.0], 'propulsion_power_w': [0.0],
            'ambient_temperature_c': [temperature_c]}, vehicle.defaults)
        solve_optimum(vehicle, parked, BatteryState(temperature_c, sum(battery.soc_range) / 2.0),
                      Goal(temperature_c, charging_planned=False))
    except Exception:
        pass


def _answer(vehicle: Vehicle, question: Question) -> SolverAnswer | Failure:
    """Return the SolverAnswer or the Failure for a Question."""
    started_s = monotonic()
    route, corrections = question.route, Corrections()
    if question.model_factors:
        *of_vehicle, propulsion = question.model_factors[:5]
        corrections = Corrections(*of_vehicle, *question.model_factors[5:])
        route = route.with_propulsion(propulsion)
    situation = route, question.state, question.goal
    try:
        from bev_preheat.nonlinear_program.solve import solve_optimum
        method_plan = plan_preheating(corrected_vehicle(vehicle, corrections), *situation,
                                      question.method) if question.method else None
        optimum = solve_optimum(vehicle, *situation, corrections=corrections)
    except InvalidInput as error:
        return Failure(str(error), monotonic() - started_s)
    except Exception as error:
        return Failure(f'{type(error).__name__}: {error}', monotonic() - started_s)
    return SolverAnswer(optimum, method_plan)
