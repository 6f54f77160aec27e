# SPDX-License-Identifier: Apache-2.0
"""The outcome of a what-if in a sentence."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.explanation import duration_text

if TYPE_CHECKING:
    from bev_preheat.recording.course import Course
    from bev_preheat.recording.player import Changes

# Two starts that differ by less are the same [s].
SAME_START_S = 1.0


def changes_in_words(changes: Changes) -> str:
    """Return the changes in words: my_car.yaml, method=paper, temperature + 2."""
    words = [] if changes.vehicle is None else [changes.vehicle]
    words += [f'{key}={value}' for key, value in changes.vehicle_keys.items()]
    words += [f'{name}={str(value).lower() if isinstance(value, bool) else value}'
              for name, value in changes.parameters.items()]
    words += [change.in_words() for change in changes.signals]
    return ' and '.join(words)


def what_if_sentence(changes: Changes, recorded: Course, changed: Course) -> str:
    """Return how the changed drive would have gone, compared with the recorded one."""
    outcome = f'{_start(recorded, changed)}{_arrival(recorded, changed)}'
    return f'With {changes_in_words(changes)} it would have {outcome}.'


def _start(recorded: Course, changed: Course) -> str:
    before, after = recorded.heating, changed.heating
    if not after:
        return 'not heated either' if not before else 'not heated'
    if not before:
        return f'started after {duration_text((after[0][0] - changed.instants[0].now_ns) / NS_PER_S)}'
    later_s = (after[0][0] - before[0][0]) / NS_PER_S
    if abs(later_s) < SAME_START_S:
        return 'started at the same time'
    return f'started {duration_text(abs(later_s))} {"later" if later_s > 0.0 else "earlier"}'


def _arrival(recorded: Course, changed: Course) -> str:
    energy = f' and used {changed.energy_wh:.0f} Wh instead of {recorded.energy_wh:.0f} Wh'
    arrival = changed.arrival
    if arrival is None or math.isnan(arrival.measured_c):
        return energy
    before = recorded.arrival
    instead = ('' if before is None or math.isnan(before.measured_c)
               else f' instead of {before.measured_c:.1f} degC')
    return f',{energy[4:]}, and arrived at {arrival.measured_c:.1f} degC{instead}'
