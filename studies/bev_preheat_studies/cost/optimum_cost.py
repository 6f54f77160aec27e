# SPDX-License-Identifier: Apache-2.0
"""Cost of the nonlinear program, compared with the planning methods and with do-mpc."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from bev_preheat.planning.engine import keep_accounts
from bev_preheat.planning.planner import METHODS, plan_preheating
from bev_preheat.planning.trip import make_trip
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.cost.figures import Figure, turns_s
from bev_preheat_studies.cost.planning_cost import GOAL, SLOW, STATE

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.nonlinear_program.solve import Optimum

# The compared calls alternate, so that both see the same load of the machine.
ROUNDS = 15
ROUNDS_WITH_SETUP = 5
PLANS_A_TURN = 20
# Required: the program takes at least this multiple of a plan's time.
LEAST_RATIOS = {'optimal_switch': 100.0, 'paper': 300.0}
MOST_OF_PEER = {'reference': 0.15, 'alpine_pass': 0.25, 'set-up': 0.5}
SAME_ENERGY_WH = 1.0


def measure(log: Callable[[str], object]) -> list[Figure]:
    """Return the Figures; `log` takes a line of progress."""
    from bev_preheat.nonlinear_program.solve import solve_optimum
    from bev_preheat_studies.cost.peer_problem import PeerProblem
    vehicle = load_vehicle('reference')
    route = load_route('reference', vehicle.defaults)
    trip = make_trip(vehicle, route)

    def solve(limited: bool = True) -> Optimum:
        return solve_optimum(vehicle, route, STATE, GOAL, limited)

    def set_up_and_solve() -> None:
        # A copy of the vehicle does not use the vehicle's cache.
        solve_optimum(replace(vehicle), route, STATE, GOAL)

    alpine_route = load_route('alpine_pass', vehicle.defaults)
    best_wh = solve().plan.energy_wh.battery_total
    # Build before do-mpc fills the memory: afterwards, the many small parts of a program are scattered over the
    # freed blocks, and evaluating them takes two to three times longer.
    solve(limited=False)
    alpine = solve_optimum(vehicle, alpine_route, STATE, GOAL)
    slow = replace(vehicle, heat_path=SLOW)
    solve_optimum(slow, route, STATE, GOAL)
    peer = PeerProblem(trip, STATE, GOAL)
    peer.solve()
    peer_schedule = peer.schedule()
    difference_wh = keep_accounts(trip, peer_schedule).energy_wh.battery_total - best_wh
    log(f'optimum {best_wh:.4f} Wh; do-mpc {difference_wh:+.4f} Wh, '
        f'{peer_schedule.temperature_c[-1] - GOAL.target_temperature_c:+.6f} K from the target')
    figures = [Figure('the same optimum, do-mpc and program: difference', abs(difference_wh), 'Wh',
                      SAME_ENERGY_WH)]
    program_s, peer_s = turns_s(solve, peer.solve, ROUNDS)
    log(f'cold solve: program {1e3 * program_s:.1f} ms, do-mpc {1e3 * peer_s:.1f} ms')
    unlimited_peer = PeerProblem(trip, STATE, GOAL, limited=False)
    unlimited_s, unlimited_peer_s = turns_s(
        lambda: solve(limited=False), unlimited_peer.solve, ROUNDS)
    log(f'without power limits: program {1e3 * unlimited_s:.1f} ms, '
        f'do-mpc {1e3 * unlimited_peer_s:.1f} ms')
    alpine_peer = PeerProblem(make_trip(vehicle, alpine_route), STATE, GOAL)
    alpine_s, alpine_peer_s = turns_s(
        lambda: solve_optimum(vehicle, alpine_route, STATE, GOAL), alpine_peer.solve, ROUNDS)
    alpine_difference_wh = keep_accounts(
        make_trip(vehicle, alpine_route), alpine_peer.schedule()).energy_wh.battery_total - (
            alpine.plan.energy_wh.battery_total)
    log(f'alpine_pass: program {1e3 * alpine_s:.1f} ms, {alpine.iterations} iterations of '
        f'{alpine.solver} from two starts, do-mpc {1e3 * alpine_peer_s:.1f} ms, '
        f'{alpine_difference_wh:+.4f} Wh')
    slow_s, direct_s = turns_s(
        lambda: solve_optimum(slow, route, STATE, GOAL), solve, ROUNDS)
    program_setup_s, peer_setup_s = turns_s(
        set_up_and_solve, lambda: PeerProblem(trip, STATE, GOAL).solve(), ROUNDS_WITH_SETUP)
    log(f'with set-up: program {program_setup_s:.2f} s, do-mpc {peer_setup_s:.2f} s')
    count = f'N = {len(route)}'
    figures += [
        Figure(f'program, cold solve, {count}, median', 1e3 * program_s, 'ms'),
        Figure(f'do-mpc, the same problem, cold solve, {count}, median', 1e3 * peer_s, 'ms'),
        Figure('cold solve, program / do-mpc', program_s / peer_s, '', MOST_OF_PEER['reference']),
        # The program first solves without limits and is done if they hold, as here; do-mpc always includes
        # the requested limits. Here neither has any.
        Figure('cold solve without power limits (9i), program / do-mpc',
               unlimited_s / unlimited_peer_s, ''),
        Figure('cold solve on alpine_pass, where limits are active, program / do-mpc',
               alpine_s / alpine_peer_s, '', MOST_OF_PEER['alpine_pass']),
        Figure('the same optimum on alpine_pass, do-mpc and program: difference',
               abs(alpine_difference_wh), 'Wh', SAME_ENERGY_WH),
        Figure('program, cold solve, with a heat path / without', slow_s / direct_s, ''),
        Figure('program, set-up and cold solve, median', 1e3 * program_setup_s, 'ms'),
        Figure('do-mpc, set-up and cold solve, median', 1e3 * peer_setup_s, 'ms'),
        Figure('set-up and cold solve, program / do-mpc', program_setup_s / peer_setup_s, '',
               MOST_OF_PEER['set-up'])]
    for method in METHODS:
        def plans(method: str = method) -> None:
            for _ in range(PLANS_A_TURN):
                plan_preheating(vehicle, route, STATE, GOAL, method)

        program_s, plans_s = turns_s(solve, plans, ROUNDS)
        figures.append(Figure(f'program, cold solve / plan by {method}',
                              PLANS_A_TURN * program_s / plans_s, '',
                              LEAST_RATIOS.get(method), '>='))
    return figures
