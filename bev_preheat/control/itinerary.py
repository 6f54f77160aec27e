# SPDX-License-Identifier: Apache-2.0
"""A trip with stops as a YAML file (see itinerary_schema.yaml)."""

from dataclasses import dataclass
from pathlib import Path

from bev_preheat.checked_yaml import load_checked_yaml
from bev_preheat.configuration import find_configuration
from bev_preheat.control.inputs import Leg, Mission, with_stops
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route import load_route, route_file

SCHEMA = Path(__file__).with_name('itinerary_schema.yaml')
STOP_KEYS = ('stop_duration_s', 'departure_temperature_c', 'departure_soc')


@dataclass(frozen=True)
class Itinerary:
    """
    A Mission that starts at instant 0.

    `route_names` is what the file calls the route of each leg; `files` are the paths of all files
    that were read.
    """

    mission: Mission
    route_names: tuple
    files: tuple


def load_itinerary(name_or_file, defaults):
    """
    Return the Itinerary of a name (a file in config/itineraries) or of a YAML file.

    `defaults` (vehicle.description.Defaults) fill columns that routes may lack. Raises
    InvalidInput naming file, key, value and what is allowed.
    """
    path = find_configuration('itineraries', name_or_file, '.yaml')
    description = load_checked_yaml(path, SCHEMA)
    nodes = description['legs']
    problems, legs, departure = _stop_problems(nodes), [], None
    files = [path]
    for index, node in enumerate(nodes):
        try:
            name = _seen_from(path.parent, node['route'])
            route = load_route(name, defaults)
            files.append(route_file(name))
        except InvalidInput as error:
            problems += [f'legs[{index}].route: {problem}' for problem in error.problems]
            continue
        legs.append(Leg(
            route=route,
            charging_planned=node.get('charging_planned', True),
            target_temperature_c=node.get('target_battery_temperature_c'),
            minimum_arrival_soc=node.get('minimum_arrival_soc', 0.0),
            departure=departure))
        if not problems and node is not nodes[-1]:
            departure = BatteryState(node['departure_temperature_c'], node['departure_soc'])
    if problems:
        raise InvalidInput([f'{path}: {problem}' for problem in problems])
    legs = with_stops(legs, [node['stop_duration_s'] for node in nodes[:-1]])
    return Itinerary(Mission(description['name'], legs), tuple(node['route'] for node in nodes),
                     tuple(files))


def _stop_problems(nodes):
    """Return what is wrong with the stops, which are between the legs and nowhere else."""
    problems = []
    for index, node in enumerate(nodes[:-1]):
        missing = [key for key in STOP_KEYS if key not in node]
        if missing:
            problems.append(f'legs[{index}]: missing {", ".join(missing)} of the stop at its end')
    beyond = [key for key in STOP_KEYS if key in nodes[-1]]
    if beyond:
        problems.append(f'legs[{len(nodes) - 1}]: {", ".join(beyond)} not allowed: no stop lies '
                        'behind the last leg')
    return problems


def _seen_from(folder, name_or_file):
    is_file = '/' in name_or_file or name_or_file.endswith('.csv')
    return folder / name_or_file if is_file else name_or_file
