# SPDX-License-Identifier: Apache-2.0
"""`preheat plan`: heating plan of a route, or of each leg of a trip with stops, with its energy."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from typing import Any

from bev_preheat.charging.stop import CERTAIN, chance_text, ChargingProspect
from bev_preheat.charging.target_worth import ENERGY_PRICE_PER_KWH, Prices, VALUE_OF_TIME_PER_H
from bev_preheat.commands.output import add_output_arguments, check_output_arguments, print_plans, write_results
from bev_preheat.commands.parser import completed_by, given_options, Subparsers
from bev_preheat.commands.situation import (
    add_method_argument,
    add_prospect_arguments,
    add_situation_arguments,
    in_steps,
    load_planned_vehicle,
    PROSPECT_OPTIONS,
    read_prospect,
    read_situation,
    ROUTE_OPTIONS,
    target_of,
    warn,
)
from bev_preheat.control.inputs import check_mission, Leg
from bev_preheat.control.itinerary import load_itinerary
from bev_preheat.control.target import given_target_pays_from
from bev_preheat.drawing.plan_figure import make_itinerary_figure
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.sensitivity import find_sensitivity, Sensitivity
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import Route
from bev_preheat.vehicle import vehicle_file
from bev_preheat.vehicle.description import Vehicle


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'plan', help='plan the heating of a route',
        description='Start of heating on this route, or on each leg of a trip with '
        'stops, and the energy it takes.')
    route_group = parser.add_mutually_exclusive_group(required=True)
    add_situation_arguments(parser, route_group)
    completed_by('itineraries', route_group.add_argument(
        '--itinerary', metavar='NAME|FILE',
        help='a trip with stops, each leg with its target: a name in config/itineraries or a YAML file'))
    add_prospect_arguments(parser)
    add_method_argument(parser)
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Plan, print, and write the requested files; returns the exit status."""
    if arguments.itinerary is not None:
        return run_itinerary(arguments)
    prospect = read_prospect(arguments)
    if prospect.probability == 1.0 and prospect.arrival_deviation_s:
        raise InvalidInput('--arrival-deviation: only with --charging-probability below 1; certain charging is '
                           'heated for as planned')
    if arguments.no_charging and prospect != CERTAIN:
        raise InvalidInput('--charging-probability: not allowed with --no-charging')
    situation = read_situation(arguments)
    check_output_arguments(arguments, situation.files)
    plan, in_doubt = _plan_in_doubt(*situation.inputs, prospect, arguments.method)
    sensitivity = find_sensitivity(*situation.inputs, plan)
    console = write_results(arguments, lambda: {
        **_contents(plan, sensitivity, prospect, in_doubt), **situation.as_dictionary()},
        lambda: situation.figure([plan]))
    print_plans(console, [plan], situation.title)
    console.say(f'{plan.status.name}: {plan.explanation}', in_doubt,
                None if sensitivity is None else sensitivity.in_words())
    return 0


def run_itinerary(arguments: Namespace) -> int:
    """Plan each leg, print, and write the requested files; returns the exit status."""
    _refuse_what_legs_say(arguments)
    vehicle = load_planned_vehicle(arguments.vehicle)
    itinerary = load_itinerary(arguments.itinerary, vehicle)
    if arguments.target is not None and not any(
            leg.charging_planned and leg.target_temperature_c is None for leg in itinerary.mission.legs):
        raise InvalidInput('--target: not allowed with this itinerary, because each charging leg has its own')
    warn(*itinerary.warnings)
    check_output_arguments(arguments, (vehicle_file(arguments.vehicle), *itinerary.files))
    # The first leg starts from the measured state.
    first, *others = itinerary.mission.legs
    first = replace(first, departure=BatteryState(arguments.temperature, arguments.soc))
    legs = tuple(replace(leg, route=in_steps(leg.route, arguments)) for leg in (first, *others))
    target_c = target_of(arguments, vehicle)
    check_mission(vehicle, replace(itinerary.mission, legs=legs), target_c)
    situations = [_situation(vehicle, leg, target_c) for leg in legs]
    plans, doubts = zip(*(_plan_in_doubt(*situation, leg.prospect, arguments.method)
                          for situation, leg in zip(situations, legs)))
    starts_s = [leg.start_ns / NS_PER_S for leg in legs]
    headings = [f'{number}: {name}' for number, name in enumerate(itinerary.route_names, start=1)]
    title = f'vehicle {vehicle.name}, itinerary {itinerary.mission.route_id}'
    console = write_results(arguments, lambda: {
        'itinerary': itinerary.mission.route_id, 'vehicle_assumed': list(vehicle.assumed),
        'plans': [{'route': name, 'route_made_for': made_for, 'departure_s': start_s, **contents}
                  for name, made_for, start_s, contents in zip(
                      itinerary.route_names, itinerary.routes_made_for, starts_s, (
                          _contents(plan, find_sensitivity(*situation, plan), leg.prospect, in_doubt)
                          for plan, situation, leg, in_doubt in zip(plans, situations, legs, doubts)))]},
        lambda: make_itinerary_figure(vehicle, legs, plans, title))
    print_plans(console, plans, title, headings,
                [('Departure after', *map(duration_text, starts_s))])
    for heading, plan, in_doubt in zip(headings, plans, doubts):
        console.say(f'{heading}: {plan.status.name}: {plan.explanation} {in_doubt}'.rstrip())
    return 0


def _contents(plan: Plan, sensitivity: Sensitivity | None, prospect: ChargingProspect,
              in_doubt: str) -> dict[str, Any]:
    """Return a Plan with its Sensitivity, and its sentence on a ChargingProspect in doubt, for JSON."""
    doubt = {'charging_probability': prospect.probability, 'prospect_explanation': in_doubt} if in_doubt else {}
    return {**plan.as_dictionary(), 'sensitivity': sensitivity and sensitivity.as_dictionary(), **doubt}


def _situation(vehicle: Vehicle, leg: Leg, target_c: float) -> tuple[Vehicle, Route, BatteryState, Goal]:
    assert leg.departure is not None
    return vehicle, leg.route, leg.departure, leg.goal(target_c)


def _refuse_what_legs_say(arguments: Namespace) -> None:
    given = given_options(arguments, (
        'min_soc', 'max_arrival_temperature', 'no_charging', *PROSPECT_OPTIONS, *ROUTE_OPTIONS))
    if given:
        raise InvalidInput(f'{", ".join(given)}: not allowed with --itinerary, because each leg has its own')


def _plan_in_doubt(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal, prospect: ChargingProspect,
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
