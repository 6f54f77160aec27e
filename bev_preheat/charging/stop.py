# SPDX-License-Identifier: Apache-2.0
"""
A stop at a charger: the charger, its surroundings, departure and prospect; the inputs of a charging session.

The prospect of charging at the end of a drive, how likely it is and how well the arrival is known, comes from
the trip planner. Nothing given means that the vehicle charges, exactly at the planned instant.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
import math
from typing import TYPE_CHECKING

from bev_preheat.errors import figure_beyond, InvalidInput, range_problem, share_hint
from bev_preheat.numerics import WH_PER_KWH
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.situation import BatteryState, check_situation
from bev_preheat.vehicle.charging import charging_of

if TYPE_CHECKING:
    from bev_preheat.planning.plan import Plan
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle

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
            problems.append(range_problem(name, value, 0.0, MOST_S, 's'))
    if problems:
        raise InvalidInput(problems)


def held_prospect(held: ChargingProspect, given: ChargingProspect) -> ChargingProspect:
    """Return the prospect to count with after `held`: the given one, unless that may be jitter."""
    most_s = DEVIATION_SHARE * max(given.arrival_deviation_s, held.arrival_deviation_s)
    # Certainty is no jitter, in either direction.
    is_jitter = (
        (given.probability == 1.0) is (held.probability == 1.0)
        and abs(given.probability - held.probability) <= PROBABILITY_STEP
        and (given.arrival_deviation_s == 0.0) is (held.arrival_deviation_s == 0.0)
        and abs(given.arrival_deviation_s - held.arrival_deviation_s) <= most_s
        and (given.known_before_arrival_s, given.wait_s) == (held.known_before_arrival_s, held.wait_s))
    return held if is_jitter else given


# The weakest charger gives more than this; a smaller value is in kilowatts by mistake.
CHARGER_RANGE_W = (1000.0, 2e6)
MOST_SIDE_POWER_W = 50e3
# Fast charging slows down from there, so most stops end there.
USUAL_DEPARTURE_SOC = 0.8
HOTTEST_AMBIENT_C = 60.0


@dataclass(frozen=True)
class Charger:
    """A charger as known before the drive: its power [W, at the inlet], and the charge to leave with, if known."""

    power_w: float
    departure_soc: float | None = None


@dataclass(frozen=True)
class ChargingStop:
    """
    A stop at a charger: its power [W, at the vehicle's inlet], and the state of charge (0 ... 1) to leave with.

    `ambient_c` [deg C] is the air; `cabin_heating_power_w` and `auxiliary_power_w` [W] are drawn during the
    session.
    """

    charger_power_w: float
    departure_soc: float
    ambient_c: float
    cabin_heating_power_w: float
    auxiliary_power_w: float


def stop_after(route: Route, charger_power_w: float, departure_soc: float) -> ChargingStop:
    """Return the ChargingStop at the end of a Route: air, cabin and auxiliaries as in its last segment."""
    return ChargingStop(charger_power_w, departure_soc, float(route.ambient_temperature_c[-1]),
                        float(route.cabin_heating_power_w[-1]), float(route.auxiliary_power_w[-1]))


def refuse_stranded(plan: Plan) -> None:
    """Raise InvalidInput if the charge is not enough for the unheated drive to the charger."""
    if plan.stranding is not None:
        raise InvalidInput(
            f'state of charge: {100.0 * plan.soc[0]:g} % is not enough for this trip, even without '
            f'heating: the battery will be empty in {duration_text(plan.stranding.at_s)} '
            f'({plan.stranding.deficit_wh / WH_PER_KWH:.2f} kWh short)')


def check_stop(vehicle: Vehicle, stop: ChargingStop, state: BatteryState | None = None) -> None:
    """
    Raise InvalidInput, one sentence per problem, if a session is impossible.

    Vehicle files that do not say whether the car heats while it charges are refused, and so is a
    `state` (BatteryState on arrival) outside the vehicle's model or charged beyond departure.
    """
    charging_of(vehicle)
    battery = vehicle.battery
    problems = [
        range_problem(name, value, low, high, unit, share_hint(value) if high <= 1.0 else '')
        for name, value, (low, high), unit in (
            ('charger power', stop.charger_power_w, CHARGER_RANGE_W, 'W'),
            ('departure state of charge', stop.departure_soc, battery.soc_range,
             "(the vehicle's soc_range)"),
            ('ambient temperature', stop.ambient_c,
             (battery.temperature_range_c[0], HOTTEST_AMBIENT_C), 'degC'),
            ('cabin heating power', stop.cabin_heating_power_w, (0.0, MOST_SIDE_POWER_W), 'W'),
            ('auxiliary power', stop.auxiliary_power_w, (0.0, MOST_SIDE_POWER_W), 'W'))
        if not low <= value <= high]
    if state is not None:
        try:
            check_situation(vehicle, state=state)
        except InvalidInput as error:
            problems += error.problems
        if not problems and state.soc > stop.departure_soc:
            problems.append(
                f'departure state of charge: {stop.departure_soc:g} is below the '
                f'{math.floor(1000.0 * state.soc) / 1000.0:g} that the battery arrives with; it must '
                'be at least that')
    if problems:
        raise InvalidInput(problems)
