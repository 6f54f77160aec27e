# SPDX-License-Identifier: Apache-2.0
"""`preheat plan`: heating plan of a route, with its energy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.commands.itinerary import add_itinerary_argument, run_itinerary
from bev_preheat.commands.method_argument import add_method_argument
from bev_preheat.commands.output import add_output_arguments, check_output_arguments, print_plans, write_json
from bev_preheat.commands.prospect import add_prospect_arguments, plan_in_doubt, read_prospect
from bev_preheat.commands.situation import add_situation_arguments, read_situation
from bev_preheat.commands.terminal import result_console
from bev_preheat.planning.sensitivity import find_sensitivity

if TYPE_CHECKING:
    from argparse import Namespace

    from bev_preheat.commands.arguments import Subparsers


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'plan', help='plan the heating of a route',
        description='Start of heating on this route, or on each leg of a trip with '
        'stops, and the energy it takes.')
    route_group = parser.add_mutually_exclusive_group(required=True)
    add_situation_arguments(parser, route_group)
    add_itinerary_argument(route_group)
    add_prospect_arguments(parser)
    add_method_argument(parser)
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Plan, print, and write the requested files; returns the exit status."""
    if arguments.itinerary is not None:
        return run_itinerary(arguments)
    prospect = read_prospect(arguments)
    situation = read_situation(arguments)
    check_output_arguments(arguments, situation.files)
    plan, in_doubt = plan_in_doubt(situation.vehicle, situation.route, situation.state, situation.goal,
                                   prospect, arguments.method)
    sensitivity = find_sensitivity(
        situation.vehicle, situation.route, situation.state, situation.goal, plan)
    title = f'vehicle {situation.vehicle.name}, route {arguments.route}'
    if arguments.json:
        write_json(arguments.json, {**plan.as_dictionary(),
                                    'sensitivity': sensitivity and sensitivity.as_dictionary(),
                                    **situation.as_dictionary(),
                                    **({'charging_probability': prospect.probability,
                                        'prospect_explanation': in_doubt} if in_doubt else {})})
    if arguments.plot:
        from bev_preheat.drawing.plan_figure import draw_plans
        draw_plans(arguments.plot, situation.vehicle, situation.route, situation.goal, [plan],
                   title)
    console = result_console(arguments.json)
    print_plans(console, [plan], title)
    console.say(f'{plan.status.name}: {plan.explanation}', in_doubt,
                None if sensitivity is None else sensitivity.in_words())
    return 0
