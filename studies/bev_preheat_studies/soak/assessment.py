# SPDX-License-Identifier: Apache-2.0
"""Assess the figures of a soak test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from bev_preheat_studies.soak.load import SoakLoad

# Largest growth of the memory in ten minutes [MB], after the first part, in which caches fill.
MOST_GROWTH_MB_IN_10_MIN = 1.0
WARM_UP_SHARE = 0.2
# A command this much later than its period counts as missed [s]: the computer may be busy.
LATE_BY_S = 0.5


@dataclass(frozen=True)
class Assessment:
    """A figure: its name, its value and bound as texts, and whether the bound is met."""

    what: str
    value: str
    allowed: str
    good: bool


def memory_growth_mb_in_10_min(instants_s: ArrayLike, memory_mb: ArrayLike) -> float:
    """
    Return the growth of the memory after the warm-up, from samples [s], [MB].

    The median of the slopes between all pairs of samples (Theil-Sen): a single step, when a cache fills,
    is not a leak.
    """
    instants_s, memory_mb = np.asarray(instants_s, float), np.asarray(memory_mb, float)
    kept = instants_s >= instants_s[0] + WARM_UP_SHARE * (instants_s[-1] - instants_s[0])
    x, y = instants_s[kept], memory_mb[kept]
    if len(x) < 3:
        return 0.0
    first, second = np.triu_indices(len(x), k=1)
    apart_s = x[second] - x[first]
    slopes = (y[second] - y[first])[apart_s > 0.0] / apart_s[apart_s > 0.0]
    return float(np.median(slopes)) * 600.0


def judge(load: SoakLoad, memory_samples: Sequence[tuple[float, float]], command_period_s: float,
          exit_status: int | None) -> list[Assessment]:
    """
    Return the Assessments of a soak test.

    `load` is a finished SoakLoad, `memory_samples` are (instant [s], resident memory [MB]),
    `exit_status` is the planner's after SIGTERM, None if it had died before.
    """
    arrivals_s = np.array([instant_s for instant_s, _, _ in load.commands])
    intervals_s = np.diff(arrivals_s)
    missed = int((intervals_s > command_period_s + LATE_BY_S).sum())
    growth_mb = memory_growth_mb_in_10_min(*zip(*memory_samples))
    longest_s = float(intervals_s.max()) if len(intervals_s) else float('inf')
    return [
        Assessment('process', 'ended cleanly' if exit_status == 0 else f'status {exit_status}',
                   'ends cleanly on SIGTERM', exit_status == 0),
        Assessment('resident memory, growth in 10 min', f'{growth_mb:+.3f} MB',
                   f'at most {MOST_GROWTH_MB_IN_10_MIN:g} MB',
                   growth_mb <= MOST_GROWTH_MB_IN_10_MIN),
        Assessment('resident memory at the end', f'{memory_samples[-1][1]:.1f} MB', '', True),
        Assessment('command periods missed', str(missed), '0', missed == 0),
        Assessment('longest time without a command', f'{longest_s:.3f} s',
                   f'at most {command_period_s + LATE_BY_S:g} s',
                   longest_s <= command_period_s + LATE_BY_S),
        Assessment('forbidden commands', '; '.join(load.wrong[:3]) or '0', '0',
                   not load.wrong),
        Assessment('internal errors', str(load.internal_errors), '0', load.internal_errors == 0),
        Assessment('battery states sent', str(load.states_sent), '', True),
        Assessment('garbage messages', str(load.garbage_sent), 'some', load.garbage_sent > 0),
        Assessment('routes sent', str(load.routes_sent), '', True),
        Assessment('service calls', str(load.calls), '', True),
        Assessment('commands heard', str(len(load.commands)), '', True),
        Assessment('of these, heating', str(load.heating_commands), 'some',
                   load.heating_commands > 0),
    ]
