# SPDX-License-Identifier: Apache-2.0
"""`preheat plan --itinerary`: a trip with stops, leg by leg."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from bev_preheat.commands.completion import completed_by, NameCompleter
from bev_preheat.commands.output import check_output_arguments, print_plans, write_json
from bev_preheat.commands.prospect import given_prospect_options, plan_in_doubt
from bev_preheat.commands.situation import in_steps, load_planned_vehicle, target_of, warn
from bev_preheat.commands.terminal import result_console
from bev_preheat.control.inputs import check_mission, Leg
from bev_preheat.control.itinerary import load_itinerary
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.sensitivity import find_sensitivity
from bev_preheat.planning.situation import BatteryState
from bev_preheat.vehicle import vehicle_file

if TYPE_CHECKING:
    from argparse import Namespace
    from typing import Any

    from bev_preheat.commands.arguments import Alternatives
    from bev_preheat.planning.plan import Plan
    from bev_preheat.vehicle.description import Vehicle


def add_itinerary_argument(parser: Alternatives) -> None:
    """Add the alternative to `--route`."""
    completed_by(NameCompleter('itineraries'), parser.add_argument(
        '--itinerary', metavar='NAME|FILE',
        help='a trip with stops, each leg with its target: a name in config/itineraries or a YAML '
        'file'))


def run_itinerary(arguments: Namespace) -> int:
    """Plan each leg, print, and write the requested files; returns the exit status."""
    _refuse_what_legs_say(arguments)
    vehicle = load_planned_vehicle(arguments.vehicle)
    itinerary = load_itinerary(arguments.itinerary, vehicle)
    warn(*itinerary.warnings)
    check_output_arguments(arguments, (vehicle_file(arguments.vehicle), *itinerary.files))
    # The first leg starts from the measured state.
    first, *others = itinerary.mission.legs
    first = replace(first, departure=BatteryState(arguments.temperature, arguments.soc))
    legs = tuple(replace(leg, route=in_steps(leg.route, arguments)) for leg in (first, *others))
    target_c = target_of(arguments, vehicle)
    check_mission(vehicle, replace(itinerary.mission, legs=legs), target_c)
    plans, doubts = zip(*(_plan(vehicle, leg, target_c, arguments.method) for leg in legs))
    starts_s = [leg.start_ns / NS_PER_S for leg in legs]
    headings = [f'{number}: {name}' for number, name in enumerate(itinerary.route_names, start=1)]
    title = f'vehicle {vehicle.name}, itinerary {itinerary.mission.route_id}'
    if arguments.json:
        write_json(arguments.json, {
            'itinerary': itinerary.mission.route_id,
            'vehicle_assumed': list(vehicle.assumed),
            'plans': [{'route': name, 'route_made_for': made_for, 'departure_s': start_s,
                       **plan.as_dictionary(), 'sensitivity': _sensitivity(vehicle, leg, target_c, plan)}
                      for name, made_for, start_s, plan, leg in zip(
                          itinerary.route_names, itinerary.routes_made_for, starts_s, plans, legs)]})
    if arguments.plot:
        from bev_preheat.drawing.itinerary_figure import draw_itinerary
        draw_itinerary(arguments.plot, vehicle, legs, plans, title)
    console = result_console(arguments.json)
    print_plans(console, plans, title, headings,
                [('Departure after', *map(duration_text, starts_s))])
    for heading, plan, in_doubt in zip(headings, plans, doubts):
        console.say(f'{heading}: {plan.status.name}: {plan.explanation} {in_doubt}'.rstrip())
    return 0


def _plan(vehicle: Vehicle, leg: Leg, target_c: float, method: str) -> tuple[Plan, str]:
    """Return the Plan of a Leg from its departure on, and the sentence on its prospect of charging."""
    assert leg.departure is not None
    return plan_in_doubt(vehicle, leg.route, leg.departure, leg.goal(target_c), leg.prospect, method)


def _sensitivity(vehicle: Vehicle, leg: Leg, target_c: float, plan: Plan) -> dict[str, Any] | None:
    """Return the Sensitivity of a Leg's Plan to the temperature at its departure as in the JSON; None for none."""
    assert leg.departure is not None
    found = find_sensitivity(vehicle, leg.route, leg.departure, leg.goal(target_c), plan)
    return None if found is None else found.as_dictionary()


def _refuse_what_legs_say(arguments: Namespace) -> None:
    given = [name for name, value in (('--min-soc', arguments.min_soc),
                                      ('--no-charging', arguments.no_charging)) if value]
    given += given_prospect_options(arguments)
    if given:
        raise InvalidInput(f'{", ".join(given)}: not allowed with --itinerary, because each leg '
                           'has its own')
