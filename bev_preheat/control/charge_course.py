# SPDX-License-Identifier: Apache-2.0
"""
The course of the state of charge against the route, where the battery's power is not measured.

If the charge rises by more than the route's descents give, the vehicle is charged; if the charge stays where the
route takes from it, the vehicle stands. Both take minutes, longer if the signal is coarse.
"""

from __future__ import annotations

from itertools import dropwhile
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.estimation.readings import Resolution, SOC_STEPS
from bev_preheat.numerics import NS_PER_S
from bev_preheat.tunables import (
    BEYOND_REGENERATION,
    CHANGED_CHARGE,
    CHARGE_COURSE_S,
    CHARGE_EVERY_S,
    HIGHEST_SHOWN_SOC,
    LEAST_TAKEN,
    LOWEST_SHOWN_SOC,
    RISES_WITHIN_S,
    SOC_JUMP,
    SOC_JUMP_PER_S,
    SOC_JUMP_STEPS,
    STANDING_AFTER_LONG_S,
    STANDS_SHARE,
)

if TYPE_CHECKING:
    from bev_preheat.control.regime import PlannedPower


class CourseSample(NamedTuple):
    """
    A state of charge (0 ... 1) at an instant [ns].

    Since the course began the route takes about `taken` of the charge, regenerates at most `regenerated`, and
    the heat sources were commanded to take `heated`. In the last STANDING_AFTER_LONG_S it takes at least `least`.
    """

    stamp_ns: int
    soc: float
    taken: float = 0.0
    regenerated: float = 0.0
    heated: float = 0.0
    least: float = 0.0


class ChargeCourse(NamedTuple):
    """The latest CourseSample, None before the first, and those of CHARGE_COURSE_S, CHARGE_EVERY_S apart."""

    latest: CourseSample | None = None
    samples: tuple[CourseSample, ...] = ()
    steps: Resolution = Resolution(SOC_STEPS)

    def seen(self, stamp_ns: int, soc: float, planned: PlannedPower, command_w: float,
             full_j: float) -> ChargeCourse:
        """Return the course after a charge under a PlannedPower and a command [W]; `full_j` [J] is 1."""
        before, steps = self.latest, self.steps.seen(soc)
        sample = CourseSample(stamp_ns, soc)
        if before is not None:
            elapsed_s = (stamp_ns - before.stamp_ns) / NS_PER_S
            if abs(soc - before.soc) > SOC_JUMP + SOC_JUMP_STEPS * steps.step + SOC_JUMP_PER_S * elapsed_s:
                # The display is corrected.
                return ChargeCourse(sample, (sample,), steps)
            per_w = elapsed_s / full_j
            sample = CourseSample(
                stamp_ns, soc, before.taken + per_w * planned.least_in_300_s_w,
                before.regenerated + per_w * max(0.0, -planned.least_in_60_s_w), before.heated + per_w * command_w,
                STANDING_AFTER_LONG_S / full_j * planned.least_in_300_s_w)
        samples, oldest_ns = self.samples, stamp_ns - CHARGE_COURSE_S * NS_PER_S
        if not samples or stamp_ns - samples[-1].stamp_ns >= CHARGE_EVERY_S * NS_PER_S:
            samples = (*dropwhile(lambda old: old.stamp_ns < oldest_ns, samples), sample)
        return ChargeCourse(sample, samples, steps)

    def charged_since_ns(self, least: float) -> int | None:
        """Return the instant [ns] since which the charge has risen by `least` that no descent gave; None: none."""
        recent = self._recent()
        if not recent or recent[-1].soc < max(sample.soc for sample in recent):
            return None
        latest = recent[-1]
        low = min(reversed(recent), key=lambda sample: sample.soc)
        gained = latest.soc - low.soc - self.steps.step
        given = BEYOND_REGENERATION * (latest.regenerated - low.regenerated)
        return low.stamp_ns if gained > least + given else None

    def standing_since_ns(self) -> int | None:
        """Return the instant [ns] since which the charge has stayed where the route takes it; None: none."""
        latest, step = self.latest, self.steps.step
        if latest is None:
            return None
        # Before the beginning of the stand, the charge fell by more than this share of the route's part.
        most, since, fell, lowest = step, latest, 0.0, latest.soc + latest.heated
        # The least part of the route is known for whole periods alone: its power may have fallen within one.
        planned, next_ns, part = 0.0, latest.stamp_ns, latest.least
        for sample in reversed(self.samples):
            if not LOWEST_SHOWN_SOC < sample.soc < HIGHEST_SHOWN_SOC:
                break
            unheated = sample.soc + sample.heated
            lowest = min(lowest, unheated)
            fell = max(fell, unheated - lowest)
            exceeds = STANDS_SHARE * (latest.taken - sample.taken) - fell
            if exceeds > most:
                most, since = exceeds, sample
            if next_ns - sample.stamp_ns >= STANDING_AFTER_LONG_S * NS_PER_S:
                planned, next_ns, part = planned + part, sample.stamp_ns, sample.least
                if planned >= LEAST_TAKEN and fell + step < STANDS_SHARE * planned:
                    return since.stamp_ns
        return None

    def driven_since_ns(self) -> int | None:
        """Return the instant [ns] since which the charge falls as the route takes it; None: unknown."""
        latest = self.latest
        return None if latest is None else max((latest, *reversed(self.samples)), key=lambda sample: (
            sample.soc + sample.heated + STANDS_SHARE * sample.taken)).stamp_ns

    def is_rising(self) -> bool:
        """Return whether the charge has risen within RISES_WITHIN_S and not fallen since."""
        recent = self._recent()
        return self.stays() and recent[-1].soc > recent[0].soc

    def stays(self) -> bool:
        """Return whether the charge has fallen within RISES_WITHIN_S by no more than the heat sources took."""
        recent = self._recent()
        if not recent:
            return False
        latest, highest = recent[-1], max(recent, key=lambda sample: sample.soc)
        taken = latest.heated - highest.heated
        return highest.soc - latest.soc <= taken + self.steps.step + CHANGED_CHARGE

    def _recent(self) -> list[CourseSample]:
        latest = self.latest
        return [] if latest is None else [*(
            sample for sample in self.samples
            if latest.stamp_ns - sample.stamp_ns <= RISES_WITHIN_S * NS_PER_S), latest]
