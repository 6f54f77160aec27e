# SPDX-License-Identifier: Apache-2.0
"""Cost of the public Python interface: its import, and a plan through it compared with the internal call."""

from __future__ import annotations

import os
from statistics import median
import subprocess
import sys
from typing import TYPE_CHECKING

import bev_preheat as bp
from bev_preheat.planning.planner import plan_preheating
from bev_preheat_studies.cost.figures import Figure, turns_s
from bev_preheat_studies.cost.planning_cost import GOAL, STATE

if TYPE_CHECKING:
    from collections.abc import Callable

IMPORTS, PLANS = 10, 300
# A name is loaded when it is first used, so all of them are.
NAMES = 'import bev_preheat as bp; [getattr(bp, name) for name in bp.__all__]'
PLAN_NAMES = 'import bev_preheat as bp; bp.load_vehicle, bp.load_route, bp.BatteryState, bp.plan'
MOST_IMPORT_S, MOST_RATIO = 0.3, 1.2


def measure(log: Callable[[str], object]) -> list[Figure]:
    """Return the Figures; `log` takes a line of progress."""
    started_s = _process_s('pass')
    numpy_s, plan_names_s, names_s = (
        _process_s(program) - started_s for program in ('import numpy', PLAN_NAMES, NAMES))
    log(f'an interpreter starts in {started_s:.3f} s, and imports numpy in {numpy_s:.3f} s, of processor time')
    vehicle = bp.load_vehicle('reference')
    route = bp.load_route('reference', vehicle)
    public_s, internal_s = turns_s(
        lambda: bp.plan(vehicle, route, STATE, GOAL),
        lambda: plan_preheating(vehicle, route, STATE, GOAL), PLANS)
    return [
        Figure('import of the public interface for a plan, processor time', plan_names_s, 's', MOST_IMPORT_S),
        Figure('import of all public names, processor time', names_s, 's', MOST_IMPORT_S),
        Figure('import of all public names, relative to numpy alone', names_s / numpy_s, ''),
        Figure('reference: plan through the public interface, relative to the internal call',
               public_s / internal_s, '', MOST_RATIO)]


def _process_s(program: str) -> float:
    """
    Return the median processor time of an interpreter with a program [s]; the first one does not count.

    Processor time, because other processes on the computer would lengthen the elapsed time.
    """
    durations_s = []
    for _ in range(IMPORTS + 1):
        before = os.times()
        subprocess.run([sys.executable, '-c', program], check=True)
        after = os.times()
        durations_s.append(after.children_user - before.children_user
                           + after.children_system - before.children_system)
    return median(durations_s[1:])
