# SPDX-License-Identifier: Apache-2.0
"""
Whether the current has the expected sign, positive = discharging, and the scale of the state of charge.

Evidence on the sign: the voltage falls while the discharge current rises, by the resistance: in measured drives
their changes are correlated by -0.99. The state of charge falls while the battery discharges. The latest proof
counts. On the scale: current and state of charge move the same charge. Capacities, buffers and displayed charges
differ by tens of per cent; the bound is a factor of three.
"""
from __future__ import annotations

from enum import Enum
import math
from typing import NamedTuple

from bev_preheat.tunables import (
    CHANGE_WITHIN_S,
    CURRENT_CHANGES,
    HIGHEST_SHOWN_SOC,
    LEAST_CURRENT_CHANGES,
    LEAST_CURRENT_SHARE,
    LEAST_DEVIATION_A,
    LEAST_DEVIATION_OF_ALL_A,
    LEAST_MOVED,
    LEAST_MOVED_DEVIATIONS,
    LEAST_MOVED_STEPS,
    LONGEST_COMPARED_S,
    LONGEST_GAP_S,
    LOWEST_SHOWN_SOC,
    MOST_SOC_NOISE,
    PROVES_CORRELATION,
    SCALE_ERROR,
    SCALE_ERROR_STEPS,
    SCALE_FACTOR,
    SCALE_LEAST_CHANGE,
    SCALE_LEAST_STEPS,
    SIGN_CONFIRMED_EVERY_S,
    SIGN_RESTART_AFTER,
    SOC_JUMP,
    SOC_JUMP_MOVED,
    SOC_JUMP_PER_S,
    SOC_JUMP_STEPS,
    SOC_NOISE_OVER,
)


class CurrentSample(NamedTuple):
    """Instant [s], voltage [V], current [A], state of charge (0 ... 1)."""

    instant_s: float
    voltage_v: float
    current_a: float
    soc: float

    def drawn_since(self, before: CurrentSample, capacity_as: float) -> float:
        """Return the share of a capacity [As] that the current has drawn since a sample before."""
        return 0.5 * (self.current_a + before.current_a) * (self.instant_s - before.instant_s) / capacity_as


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


class Sign(Enum):
    """State of knowledge about the sign of the current."""

    UNKNOWN = 'unknown'
    RIGHT = 'right'
    REVERSED = 'reversed'


class CurrentSign(NamedTuple):
    """
    The Sign of the current, with the evidence as a sentence.

    `before` is the latest sample, None if the next one does not follow it; `changes` are the latest changes of
    voltage and current. The charge is compared since it was `first_soc`; the current has drawn the share
    `discharged` of the capacity since, and its sensor's error up to `offset`. `latest_soc` is the latest charge
    that was compared, and `noise` the variance of its change from one state to the next. The voltage was compared
    last at `confirmed_s` [s].
    """

    sign: Sign = Sign.UNKNOWN
    evidence: str = ''
    before: CurrentSample | None = None
    changes: tuple[tuple[float, float], ...] = ()
    first_soc: float = 0.0
    discharged: float = 0.0
    offset: float = 0.0
    latest_soc: float | None = None
    noise: float = 0.0
    confirmed_s: float = -math.inf

    def without_instants(self) -> CurrentSign:
        """Return the CurrentSign whose next sample does not follow the latest one."""
        return self._replace(before=None, confirmed_s=-math.inf)

    def seen(self, sample: CurrentSample, soc_step: float, capacity_as: float) -> CurrentSign:
        """Return the CurrentSign after a sample; the battery's capacity [As], and `soc_step` of the charge."""
        before, soc = self.before, sample.soc
        elapsed_s = 0.0 if before is None else sample.instant_s - before.instant_s
        if before is None or not 0.0 < elapsed_s <= LONGEST_GAP_S:
            return self._replace(before=sample, first_soc=soc, discharged=0.0, offset=0.0)
        changes, noise = self.changes, self.noise
        if elapsed_s <= CHANGE_WITHIN_S:
            changes = (*changes, (
                sample.voltage_v - before.voltage_v, sample.current_a - before.current_a))[-CURRENT_CHANGES:]
        moved = sample.drawn_since(before, capacity_as)
        # A jump shows nothing about the current.
        offset = LEAST_DEVIATION_OF_ALL_A * elapsed_s / capacity_as
        since = (soc, 0.0, 0.0) if self._jumps(soc, moved, soc_step) else (
            self.first_soc, self.discharged + moved, self.offset + offset)
        if self.latest_soc is not None and soc_step == 0.0:
            noise += (min(abs(soc - self.latest_soc), MOST_SOC_NOISE)**2 - noise) / SOC_NOISE_OVER
        # A sign proved right is confirmed from time to time.
        is_due = self.sign is not Sign.RIGHT or sample.instant_s >= self.confirmed_s + SIGN_CONFIRMED_EVERY_S
        now = CurrentSign(self.sign, self.evidence, sample, changes, *since, soc, noise,
                          sample.instant_s if is_due else self.confirmed_s)
        return (now._by_voltage() if is_due else now)._by_charge(soc, soc_step)

    def _jumps(self, soc: float, moved: float, soc_step: float) -> bool:
        return self.latest_soc is not None and abs(soc - self.latest_soc) > SOC_JUMP_MOVED * abs(moved) + max(
            LEAST_MOVED + SOC_JUMP_STEPS * soc_step, 2.0 * LEAST_MOVED_DEVIATIONS * math.sqrt(self.noise))

    def _by_voltage(self) -> CurrentSign:
        """Return the CurrentSign after a look at the changes of voltage and current."""
        count = len(self.changes)
        if count < LEAST_CURRENT_CHANGES:
            return self
        voltages = current = mixed = 0.0
        for change_v, change_a in self.changes:
            voltages += change_v * change_v
            current += change_a * change_a
            mixed += change_v * change_a
        least_a = LEAST_DEVIATION_OF_ALL_A if count == CURRENT_CHANGES else LEAST_DEVIATION_A
        if voltages == 0.0 or current < count * least_a**2:
            return self
        correlation = mixed / math.sqrt(voltages * current)
        if correlation > PROVES_CORRELATION:
            return self._replace(
                sign=Sign.REVERSED, evidence='the voltage rises while the current discharges more')
        return self._replace(sign=Sign.RIGHT, evidence='') if correlation < -PROVES_CORRELATION else self

    def _by_charge(self, soc: float, soc_step: float) -> CurrentSign:
        """Return the CurrentSign after a look at the charge that has moved."""
        fallen, discharged = self.first_soc - soc, self.discharged
        noise = math.sqrt(0.5 * self.noise)
        least = max(LEAST_MOVED, LEAST_MOVED_STEPS * soc_step, LEAST_MOVED_DEVIATIONS * noise)
        restarted = self._replace(first_soc=soc, discharged=0.0, offset=0.0)
        if abs(fallen) < least or abs(discharged) < max(LEAST_CURRENT_SHARE * abs(fallen), 0.5 * least):
            has_long_passed = abs(discharged) > max(SIGN_RESTART_AFTER, 3.0 * least)
            return restarted if has_long_passed else self
        if abs(discharged) < self.offset:
            # A parked battery's current is no larger than the sensor's error.
            return restarted
        if fallen * discharged > 0.0:
            return restarted._replace(sign=Sign.RIGHT, evidence='')
        return restarted._replace(sign=Sign.REVERSED, evidence=(
            f'the state of charge {"fell" if fallen > 0.0 else "rose"} by {100 * abs(fallen):.1f} % while '
            f'the current says that it {"rises" if discharged < 0.0 else "falls"}'))
