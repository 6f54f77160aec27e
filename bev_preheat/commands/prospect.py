# SPDX-License-Identifier: Apache-2.0
"""The arguments on the prospect of charging, and a plan for a given target under it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from bev_preheat.charging.stop import chance_text, ChargingProspect, check_prospect
from bev_preheat.charging.target_worth import Prices
from bev_preheat.charging.worth import ENERGY_PRICE_PER_KWH, VALUE_OF_TIME_PER_H
from bev_preheat.commands.parser import option_group
from bev_preheat.control.charging_doubt import given_target_pays_from
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.planner import plan_preheating

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace

    from bev_preheat.planning.plan import Plan
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.route import Route
    from bev_preheat.vehicle import Vehicle

OPTIONS = 'charging_probability', 'arrival_deviation', 'charging_known_before'


def add_prospect_arguments(parser: ArgumentParser) -> None:
    """Add the arguments that `read_prospect` reads."""
    group = option_group(parser, 'charging or arrival in doubt')
    group.add_argument('--charging-probability', type=float, metavar='0..1',
                       help='probability that the vehicle charges on arrival, above 0 (default: it does)')
    group.add_argument('--arrival-deviation', type=float, metavar='S',
                       help='standard deviation of the arrival time [s] (default: exact)')
    group.add_argument('--charging-known-before', type=float, metavar='S',
                       help='for how long before the arrival the driver knows whether the vehicle charges [s] '
                       '(default: on arrival)')


def read_prospect(arguments: Namespace) -> ChargingProspect:
    """Return the ChargingProspect of parsed arguments; raise InvalidInput if they are not allowed."""
    probability, deviation_s, known_s = (getattr(arguments, name) for name in OPTIONS)
    prospect = ChargingProspect(
        1.0 if probability is None else probability, 0.0 if deviation_s is None else deviation_s,
        0.0 if known_s is None else known_s)
    check_prospect(prospect)
    return prospect


def given_prospect_options(arguments: Namespace) -> list[str]:
    """Return the options on the prospect that are given."""
    return [f'--{name.replace("_", "-")}' for name in OPTIONS if getattr(arguments, name) is not None]


def plan_in_doubt(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal, prospect: ChargingProspect,
                  method: str) -> tuple[Plan, str]:
    """
    Return the Plan for the target of a Goal under a ChargingProspect, and a sentence on it, '' if it is certain.

    The plan heats from the probability on from which heating to the target costs less than no heating, at the
    usual prices and a charger that gives all that the vehicle takes.
    """
    def plan_to(target_c: float) -> Plan:
        return plan_preheating(vehicle, route, state, replace(goal, target_temperature_c=target_c), method)

    plan = plan_to(goal.target_temperature_c)
    if prospect.probability == 1.0 or not goal.charging_planned or plan.heating_start_s is None:
        return plan, ''
    pays_from = given_target_pays_from(
        vehicle, route, state, goal, prospect, Prices(ENERGY_PRICE_PER_KWH, VALUE_OF_TIME_PER_H), plan_to)
    chance = f'{prospect.in_words} chance of charging'
    if prospect.probability >= pays_from:
        return plan, f'{chance}: heating pays from {chance_text(pays_from)} on.'
    if pays_from > 1.0:
        sentence = (f'{chance}: heating to this target costs more than it saves, even if the vehicle charges for '
                    'certain.')
    else:
        sentence = (f'Heating waits: {chance}; it starts after {duration_text(plan.heating_start_s)} if that '
                    f'rises to {chance_text(pays_from)}.')
    return plan_preheating(vehicle, route, state, replace(goal, heating_pays=False), method), sentence
