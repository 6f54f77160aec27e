# SPDX-License-Identifier: Apache-2.0
"""Cost of the public Python interface: its import, and a plan through it compared with the internal call."""

from __future__ import annotations

from statistics import median
import subprocess
import sys
from time import perf_counter
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
    imports = [(what, _process_s(program) - started_s) for what, program in (
        ('names for a plan', PLAN_NAMES), ('all names', NAMES))]
    log(f'an empty interpreter starts in {started_s:.3f} s')
    vehicle = bp.load_vehicle('reference')
    route = bp.load_route('reference', vehicle)
    public_s, internal_s = turns_s(
        lambda: bp.plan(vehicle, route, STATE, GOAL),
        lambda: plan_preheating(vehicle, route, STATE, GOAL), PLANS)
    return [
        *(Figure(f'import of the public interface, {what} (start of the interpreter excluded)', import_s, 's',
                 MOST_IMPORT_S) for what, import_s in imports),
        Figure('reference: plan through the public interface, relative to the internal call',
               public_s / internal_s, '', MOST_RATIO)]


def _process_s(program: str) -> float:
    """Return the median duration of an interpreter with a program [s]; the first one does not count."""
    durations_s = []
    for _ in range(IMPORTS + 1):
        started = perf_counter()
        subprocess.run([sys.executable, '-c', program], check=True)
        durations_s.append(perf_counter() - started)
    return median(durations_s[1:])
