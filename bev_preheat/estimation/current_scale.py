# SPDX-License-Identifier: Apache-2.0
"""
Whether the current and the state of charge move the same charge: a unit or a scale that is wrong by a factor.

Capacities, buffers and displayed charges differ by tens of per cent; the bound is a factor of three.
"""

from __future__ import annotations

from typing import NamedTuple

from bev_preheat.estimation.current_sample import CurrentSample
from bev_preheat.tunables import (
    HIGHEST_SHOWN_SOC,
    LONGEST_COMPARED_S,
    LONGEST_GAP_S,
    LOWEST_SHOWN_SOC,
    SCALE_ERROR,
    SCALE_ERROR_STEPS,
    SCALE_FACTOR,
    SCALE_LEAST_CHANGE,
    SCALE_LEAST_STEPS,
    SOC_JUMP,
    SOC_JUMP_PER_S,
    SOC_JUMP_STEPS,
)


class CurrentScale(NamedTuple):
    """
    Current and state of charge, compared; `doubt` is the sentence, '' while they agree.

    `before` is the latest sample, None if the next one does not follow it. The comparison began with the sample
    `first`, and the current has drawn the share `drawn` of the charge since.
    """

    doubt: str = ''
    before: CurrentSample | None = None
    first: CurrentSample | None = None
    drawn: float = 0.0

    def without_instants(self) -> CurrentScale:
        """Return the CurrentScale whose next sample does not follow the latest one."""
        return self._replace(before=None)

    def seen(self, sample: CurrentSample, soc_step: float, capacity_as: float) -> CurrentScale:
        """Return the CurrentScale after a sample; the battery's capacity [As], and `soc_step` of the charge."""
        before, first = self.before, self.first
        if before is None or first is None or not _follows(before, first, sample, soc_step):
            return CurrentScale(self.doubt, sample, sample)
        drawn = self.drawn + sample.drawn_since(before, capacity_as)
        least = max(SCALE_LEAST_CHANGE, SCALE_LEAST_STEPS * soc_step)
        changed, moved = abs(first.soc - sample.soc), abs(drawn)
        is_too_much = moved >= SCALE_FACTOR * max(least, changed + SCALE_ERROR + SCALE_ERROR_STEPS * soc_step)
        if not is_too_much and changed < least:
            return CurrentScale(self.doubt, sample, first, drawn)
        return CurrentScale('' if not is_too_much and SCALE_FACTOR * moved >= changed else (
            f'current: it moved {100.0 * moved:.1f} % of the charge while percentage changed by '
            f'{100.0 * changed:.1f} %; the unit or scale of either is wrong; voltage and current are not '
            'used'), sample, sample)


def _follows(before: CurrentSample, first: CurrentSample, sample: CurrentSample, soc_step: float) -> bool:
    elapsed_s = sample.instant_s - before.instant_s
    return (0.0 < elapsed_s <= LONGEST_GAP_S and sample.instant_s - first.instant_s <= LONGEST_COMPARED_S
            and LOWEST_SHOWN_SOC < sample.soc < HIGHEST_SHOWN_SOC and abs(sample.soc - before.soc)
            <= SOC_JUMP + SOC_JUMP_STEPS * soc_step + SOC_JUMP_PER_S * elapsed_s)
