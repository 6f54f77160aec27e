# SPDX-License-Identifier: Apache-2.0
"""A trip with stops as a YAML file (see itinerary_schema.yaml)."""

from __future__ import annotations

from dataclasses import dataclass
import math
from pathlib import Path

from bev_preheat.charging.stop import ChargingProspect
from bev_preheat.control.inputs import Leg, Mission, with_stops
from bev_preheat.errors import InvalidInput
from bev_preheat.files.checked_yaml import FileData, load_checked_yaml
from bev_preheat.files.input_files import find_configuration
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route import route_for
from bev_preheat.route.sources.journey import BESIDE_ROUTE, RouteOptions
from bev_preheat.vehicle.description import Vehicle

SCHEMA = Path(__file__).with_name('itinerary_schema.yaml')
STOP_KEYS = ('stop_duration_s', 'departure_temperature_c', 'departure_soc')


@dataclass(frozen=True)
class Itinerary:
    """
    A Mission that starts at instant 0.

    `route_names` are the names in the file of each leg's route, `routes_made_for` the names of the
    vehicles whose powers they have (None: unknown); `files` are the paths of all files that were read;
    `warnings` are sentences on routes that were made for another vehicle.
    """

    mission: Mission
    route_names: tuple[str, ...]
    routes_made_for: tuple[str | None, ...]
    files: tuple[Path, ...]
    warnings: tuple[str, ...]


def load_itinerary(name_or_file: str | Path, vehicle: Vehicle) -> Itinerary:
    """
    Return the Itinerary of a name (a file in config/itineraries) or of a YAML file.

    `vehicle` (vehicle.description.Vehicle) drives the legs that are descriptions of a road, and
    its defaults fill optional columns that are missing in other routes. Raises InvalidInput naming file, key,
    value and allowed values.
    """
    path = find_configuration('itineraries', name_or_file, '.yaml')
    description = load_checked_yaml(path, SCHEMA)
    nodes = description['legs']
    problems, legs, departure = _stop_problems(nodes), [], None
    loaded = []
    for index, node in enumerate(nodes):
        try:
            loaded.append(route_for(node['route'], vehicle, path.parent,
                                    RouteOptions(node.get('ambient_temperature_c'), offers=BESIDE_ROUTE)))
            if loaded[-1].stops:
                raise InvalidInput(f'{loaded[-1].file}: has {len(loaded[-1].stops)} charging stops; a leg of an '
                                   'itinerary has none on the way: divide the route')
        except InvalidInput as error:
            problems += [f'legs[{index}].route: {problem}' for problem in error.problems]
            continue
        # YAML reads 20 as an integer, which a field of a ROS message refuses.
        target_c = node.get('target_battery_temperature_c')
        legs.append(Leg(
            route=loaded[-1].route,
            charging_planned=node.get('charging_planned', True),
            target_temperature_c=None if target_c is None else float(target_c),
            minimum_arrival_soc=float(node.get('minimum_arrival_soc', 0.0)),
            maximum_arrival_temperature_c=float(node.get('maximum_arrival_temperature_c', math.inf)),
            departure=departure,
            prospect=ChargingProspect(float(node.get('charging_probability', 1.0)),
                                      float(node.get('arrival_time_deviation_s', 0.0)),
                                      float(node.get('charging_known_before_arrival_s', 0.0)))))
        if not problems and node is not nodes[-1]:
            departure = BatteryState(float(node['departure_temperature_c']), float(node['departure_soc']))
    if problems:
        raise InvalidInput([f'{path}: {problem}' for problem in problems])
    return Itinerary(
        Mission(description['name'], with_stops(
            legs, [float(node['stop_duration_s']) for node in nodes[:-1]])),
        tuple(node['route'] for node in nodes),
        tuple(route.made_for for route in loaded), (path, *(route.file for route in loaded)),
        tuple(dict.fromkeys(route.warning for route in loaded if route.warning)))


def _stop_problems(nodes: list[dict[str, FileData]]) -> list[str]:
    """Return the problems of the stops, which are allowed only between legs."""
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
