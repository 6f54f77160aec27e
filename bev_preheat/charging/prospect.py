# SPDX-License-Identifier: Apache-2.0
"""
The prospect of charging at the end of a drive: how likely it is, and how well the arrival is known.

These figures come from the trip planner. Nothing given means that the vehicle charges, exactly at the planned
instant.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from bev_preheat.errors import figure, figure_beyond, InvalidInput, share_hint

# Longest deviation of the arrival time, and longest time before the arrival [s]: a day.
MOST_S = 86400.0
# A prospect is revised if the probability has moved by more than this, or the deviation by this share: jitter
# changes nothing.
PROBABILITY_STEP = 0.05
DEVIATION_SHARE = 0.25


@dataclass(frozen=True)
class ChargingProspect:
    """
    The prospect of charging on arrival.

    `probability` (above 0 ... 1): the vehicle charges. `arrival_deviation_s`: standard deviation of the arrival
    time [s], normally distributed; 0: exact. `known_before_arrival_s` [s]: for how long before the arrival the
    driver knows whether the vehicle charges, as at the exit of a motorway; 0: on arrival. `wait_s` [s]: a
    vehicle that does not charge at once waits this long for the charger, without heating, and charges then;
    None: it drives on, and its heat is lost.
    """

    probability: float = 1.0
    arrival_deviation_s: float = 0.0
    known_before_arrival_s: float = 0.0
    wait_s: float | None = None

    @property
    def is_certain(self) -> bool:
        """Whether the vehicle charges for certain, exactly at the planned instant."""
        return self.probability == 1.0 and self.arrival_deviation_s == 0.0

    @property
    def heats_until_arrival(self) -> bool:
        """Whether plans heat until the planned arrival: an arrival that may be earlier needs its heat before."""
        return self.arrival_deviation_s == 0.0

    @property
    def in_words(self) -> str:
        """The probability, as part of a sentence."""
        return chance_text(self.probability)

    def seen_from(self, remaining_s: float) -> ChargingProspect:
        """Return the prospect `remaining_s` [s] before the arrival: a fact that was to be known by now is not."""
        if self.known_before_arrival_s < remaining_s:
            return self
        return replace(self, known_before_arrival_s=0.0)


CERTAIN = ChargingProspect()


def chance_text(probability: float) -> str:
    """Return a probability (0 ... 1) in percent; only certainty is 100 %."""
    percent = 100.0 * probability
    return f'{percent:.0f} %' if percent <= 99.0 or probability == 1.0 else f'{min(percent, 99.9):.1f} %'


def check_prospect(prospect: ChargingProspect) -> None:
    """Raise InvalidInput, one sentence per quantity, if a ChargingProspect is not allowed."""
    problems = []
    # A vehicle that waits charges in any case.
    is_possible = prospect.probability > 0.0 or (prospect.wait_s is not None and prospect.probability == 0.0)
    if not (is_possible and prospect.probability <= 1.0):
        problems.append(f'charging probability: {figure_beyond(prospect.probability, 0.0, 1.0)} is not allowed; '
                        'it must be above 0 ... 1; without any charging there is nothing to plan'
                        f'{share_hint(prospect.probability)}')
    for name, value in (('arrival deviation', prospect.arrival_deviation_s),
                        ('time before arrival', prospect.known_before_arrival_s)):
        if not 0.0 <= value <= MOST_S:
            problems.append(f'{name}: {figure_beyond(value, 0.0, MOST_S)} is not allowed; it must be 0 ... '
                            f'{figure(MOST_S)} s')
    if problems:
        raise InvalidInput(problems)


def held_prospect(held: ChargingProspect, given: ChargingProspect) -> ChargingProspect:
    """Return the prospect to count with after `held`: the given one, unless that may be jitter."""
    # Certainty is no jitter, in either direction.
    is_near = (given.probability == 1.0) is (held.probability == 1.0) and abs(
        given.probability - held.probability) <= PROBABILITY_STEP
    most_s = DEVIATION_SHARE * max(given.arrival_deviation_s, held.arrival_deviation_s)
    is_near = is_near and (given.arrival_deviation_s == 0.0) is (held.arrival_deviation_s == 0.0)
    if (is_near and abs(given.arrival_deviation_s - held.arrival_deviation_s) <= most_s
            and (given.known_before_arrival_s, given.wait_s) == (
                held.known_before_arrival_s, held.wait_s)):
        return held
    return given
