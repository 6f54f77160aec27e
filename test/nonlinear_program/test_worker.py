# SPDX-License-Identifier: Apache-2.0
"""The solver's process: its answers, and that its failures never reach its owner."""

from dataclasses import replace
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import numpy as np
import psutil
import pytest
from waiting import poll_until

from bev_preheat.nonlinear_program.solve import solve_optimum
from bev_preheat.nonlinear_program.solver_process import Failure, Question, SolverAnswer, SolverProcess
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

pytestmark = pytest.mark.costly

VEHICLE = load_vehicle('reference')
ROUTE = load_route('city_stop_and_go', VEHICLE.defaults).resampled(60.0)
# Takes more than a minute to solve.
LONG_ROUTE = load_route('motorway_3h', VEHICLE.defaults).resampled(1.0)
STATE = BatteryState(-6.5, 0.84)
GOAL = Goal(21.0, 0.12)
QUESTION = Question(ROUTE, STATE, GOAL)
LONG_QUESTION = Question(LONG_ROUTE, STATE, GOAL)

PATIENCE_S = 300.0
# A call that waited for a hanging process would wait forever.
BLOCKED_S = 20.0

# Asks, prints the solving process, and is killed before it gets the answer.
OWNER = """
import sys, time
from bev_preheat.nonlinear_program.solver_process import Question, SolverProcess
sys.path[:0] = sys.argv[1:]
from test_worker import LONG_QUESTION, VEHICLE
solver = SolverProcess(VEHICLE, niceness=0)
solver.ask(LONG_QUESTION, 300.0)
while not solver.is_solving:
    assert solver.poll() is None
    time.sleep(0.01)
print(solver.process_id, flush=True)
time.sleep(300.0)
"""


def children():
    return [child.pid for child in psutil.Process().children() if is_solver(child)]


def is_solver(process):
    try:
        return 'bev_preheat.nonlinear_program.worker' in ' '.join(process.cmdline())
    except (psutil.NoSuchProcess, psutil.ZombieProcess):
        # Killed; without computing time it may be released later.
        return False


def closed_at_the_end():
    others = children()
    # At the lowest priority it gets no computing time for minutes on a busy computer.
    solver = SolverProcess(VEHICLE, niceness=0)
    yield solver
    solver.close()
    assert children() == others


@pytest.fixture
def new_solver():
    """A SolverProcess without a process yet."""
    yield from closed_at_the_end()


@pytest.fixture(scope='module')
def lasting():
    yield from closed_at_the_end()


@pytest.fixture
def solver(lasting):
    """The SolverProcess that tests share, because a process takes a while to start."""
    assert not lasting.is_busy and not lasting.is_starting
    return lasting


def answer_of(solver):
    return poll_until(solver.poll, 'an answer')


def let_it_solve(solver, question, time_limit_s=PATIENCE_S):
    """Ask, and return once the process has the question."""
    solver.ask(question, time_limit_s)
    poll_until(lambda: solver.poll() or solver.is_solving, 'the start of the solver')
    assert solver.is_busy


def is_gone(process_id):
    try:
        return psutil.Process(process_id).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def test_answers_what_the_solver_finds_here(solver):
    solver.ask(QUESTION, PATIENCE_S)
    solution = answer_of(solver)
    here = solve_optimum(VEHICLE, ROUTE, STATE, GOAL)
    assert isinstance(solution, SolverAnswer)
    optimum = solution.optimum
    assert (optimum.solver_status, optimum.deficit) == (here.solver_status, ())
    assert optimum.solve_time_s > 0.0
    assert optimum.plan.energy_wh.battery_total == pytest.approx(
        here.plan.energy_wh.battery_total, rel=1e-8)
    np.testing.assert_allclose(optimum.plan.battery_temperature_c,
                               here.plan.battery_temperature_c, atol=1e-4)
    assert solution.method_plan is None
    assert not solver.is_busy


def test_plans_with_a_method_where_asked_to(solver):
    solver.ask(Question(ROUTE, STATE, GOAL, 'paper'), PATIENCE_S)
    solution = answer_of(solver)
    here = plan_preheating(VEHICLE, ROUTE, STATE, GOAL, 'paper')
    assert solution.method_plan.energy_wh == here.energy_wh
    assert solution.method_plan.heating_start_s == here.heating_start_s
    assert solution.method_plan.method == 'paper'


# The processes of the tests above have the priority that is asked for, daily.
@pytest.mark.deep
def test_the_process_gives_way_to_all_others():
    solver = SolverProcess(VEHICLE)
    solver.start()
    try:
        poll_until(lambda: psutil.Process(solver.process_id).nice() == 19, 'the lowest priority')
        oom_score = Path(f'/proc/{solver.process_id}/oom_score_adj')
        poll_until(lambda: not oom_score.exists() or oom_score.read_text() == '1000\n',
                   'the first to go where memory runs short')
    finally:
        solver.close()


def test_gives_up_at_the_time_limit_and_goes_on(solver):
    solver.ask(LONG_QUESTION, 0.2)
    failure = answer_of(solver)
    assert failure.explanation == 'no solution within the time limit of 0.2 s'
    assert 0.2 < failure.elapsed_s < 0.2 + BLOCKED_S
    assert solver.process_id is None
    solver.ask(QUESTION, PATIENCE_S)
    assert isinstance(answer_of(solver), SolverAnswer)


# A process that is ended while it solves, and another one: at the time limit above, daily.
@pytest.mark.deep
def test_a_newer_question_ends_the_solving_of_the_older(solver):
    let_it_solve(solver, LONG_QUESTION)
    older = solver.process_id
    solver.ask(QUESTION, PATIENCE_S)
    solution = answer_of(solver)
    assert len(solution.optimum.plan.time_s) == len(ROUTE) + 1
    poll_until(lambda: is_gone(older), 'the end of the older process')


def test_says_so_when_its_process_is_killed_and_starts_another(solver):
    let_it_solve(solver, LONG_QUESTION)
    os.kill(solver.process_id, signal.SIGKILL)
    failure = answer_of(solver)
    assert failure.explanation == 'the solver process ended with SIGKILL'
    solver.ask(QUESTION, PATIENCE_S)
    assert isinstance(answer_of(solver), SolverAnswer)


def test_never_waits_for_a_process_that_hangs(solver):
    solver.ask(QUESTION, PATIENCE_S)
    answer_of(solver)
    hanging = solver.process_id
    os.kill(hanging, signal.SIGSTOP)
    # More than a socket buffers without a reader.
    long_route = load_route('reference', VEHICLE.defaults).resampled(0.05)
    slowest_s = 0.0
    started_s = time.monotonic()
    solver.ask(Question(long_route, STATE, GOAL), 0.3)
    answer = None
    while answer is None:
        slowest_s = max(slowest_s, time.monotonic() - started_s)
        started_s = time.monotonic()
        answer = solver.poll()
    assert slowest_s < BLOCKED_S
    assert answer.explanation == 'no solution within the time limit of 0.3 s'
    solver.close()
    assert is_gone(hanging)


def test_gives_up_a_process_that_does_not_start():
    solver = SolverProcess(VEHICLE, start_limit_s=0.01)
    solver.ask(QUESTION, PATIENCE_S)
    assert answer_of(solver).explanation == 'the solver process did not start within 0.01 s'
    solver.close()


def let_it_start(solver):
    """Start the process, and return once it waits for questions."""
    solver.start()
    assert solver.is_starting
    poll_until(lambda: solver.poll() or not solver.is_starting, 'the start')
    assert not solver.is_busy


@pytest.mark.parametrize('factors', [pytest.param((), marks=pytest.mark.deep), (0.93, 1.21, 1.34, 0.88, 1.07)])
def test_a_process_that_was_started_answers_with_the_factors_that_it_is_told(new_solver, factors):
    let_it_start(new_solver)
    started = new_solver.process_id
    new_solver.ask(Question(ROUTE.after(17.0), STATE, GOAL, '', factors), PATIENCE_S)
    plan = answer_of(new_solver).optimum.plan
    assert new_solver.process_id == started
    vehicle, route = VEHICLE, ROUTE.after(17.0)
    if factors:
        vehicle = corrected_vehicle(vehicle, Corrections(*factors[:4]))
        route = route.with_propulsion(factors[4])
    here = solve_optimum(vehicle, route, STATE, GOAL).plan
    assert plan.energy_wh.battery_total == pytest.approx(here.energy_wh.battery_total, abs=1e-3)


def test_a_car_with_more_heat_sources_has_a_factor_on_their_heat():
    vehicle = load_vehicle('heat_pump_car')
    route = load_route('reference', vehicle.defaults).resampled(120.0)
    found = solve_optimum(vehicle, route, STATE, Goal(14.0), corrections=Corrections(source_heat=0.7))
    solver = SolverProcess(vehicle, niceness=0)
    solver.ask(Question(route, STATE, Goal(14.0), '', (1.0, 1.0, 1.0, 1.0, 1.0, 0.7)), PATIENCE_S)
    asked = answer_of(solver)
    solver.close()
    weaker = replace(vehicle, heat_sources=tuple(replace(source, hvch_watts=source.hvch_watts.changed(
        lambda watts: 0.7 * watts if watts > 0.0 else watts)) for source in vehicle.heat_sources))
    expected = solve_optimum(weaker, route, STATE, Goal(14.0)).plan.energy_wh.battery_total
    assert found.plan.energy_wh.battery_total == pytest.approx(expected, abs=0.05)
    assert asked.optimum.plan.energy_wh.battery_total == pytest.approx(expected, abs=0.05)
    assert expected > solve_optimum(vehicle, route, STATE, Goal(14.0)).plan.energy_wh.battery_total + 20.0


def test_says_so_when_no_process_can_be_started_before_the_first_question(new_solver, monkeypatch):
    monkeypatch.setattr(sys, 'executable', '/nowhere/python')
    new_solver.start()
    assert not new_solver.is_starting
    assert '/nowhere/python' in answer_of(new_solver).explanation
    assert new_solver.poll() is None


def test_refuses_what_the_model_does_not_describe(solver):
    solver.ask(Question(ROUTE, BatteryState(STATE.temperature_c, 1.5), GOAL), PATIENCE_S)
    failure = answer_of(solver)
    assert isinstance(failure, Failure)
    assert failure.explanation == 'state of charge: 1.5 is not allowed; it must be 0 ... 1'
    solver.ask(QUESTION, PATIENCE_S)
    assert isinstance(answer_of(solver), SolverAnswer)


def test_the_process_ends_when_its_owner_is_killed_while_it_solves():
    owner = subprocess.Popen([sys.executable, '-c', OWNER, *map(str, Path(__file__).parents[:2])],
                             stdout=subprocess.PIPE, text=True)
    with owner:
        process_id = int(owner.stdout.readline())
        try:
            assert not is_gone(process_id)
        finally:
            owner.kill()
    poll_until(lambda: is_gone(process_id), 'the end of the orphan')


def test_asking_loads_no_solver_and_no_ros():
    done = subprocess.run(
        [sys.executable, '-c', 'import sys, bev_preheat.nonlinear_program.solver_process\n'
         "print([name for name in ('casadi', 'rclpy', 'matplotlib') if name in sys.modules])"],
        capture_output=True, text=True, check=True)
    assert done.stdout.strip() == '[]'
