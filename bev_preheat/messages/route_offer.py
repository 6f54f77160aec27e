# SPDX-License-Identifier: Apache-2.0
"""The route of a file as a RoutePlan, and its line for positions."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, replace
import math
from typing import TYPE_CHECKING

from bev_preheat.control.inputs import Leg, Mission
from bev_preheat.errors import figure, InvalidInput
from bev_preheat.messages.fields import known, LONGEST_ROUTE_ID, route_id_problems, time_message
from bev_preheat.messages.route_plan import charger_of, route_plan_message
from bev_preheat.planning.situation import check_situation
from bev_preheat.route import route_for
from bev_preheat.route.line import MapLine
from bev_preheat.route.segments import LIMITS
from bev_preheat.route.sources.journey import Offers, RouteOptions
from bev_preheat.tunables import MOST_STOPS
from bev_preheat.vehicle import load_vehicle

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from bev_preheat.route.for_vehicle import RouteForVehicle
    from bev_preheat.vehicle.description import Vehicle
    from bev_preheat_msgs.msg import RoutePlan

# No ambient temperature [deg C]; ROS parameters have no None, and a NaN does not survive a parameter file.
NO_AMBIENT_C = -100.0
# The parameters of the node.
OFFERS = Offers('{}:={}', {
    'ambient_temperature_c': ('parameter ambient_temperature', 'degC', -5.0),
    'free_speed_kmh': ('parameter free_speed', 'm/s', 25.0),
    'stop_duration_s': ('parameter stop_duration', 's', 1200.0), 'vehicle_id': ('parameter vehicle_id', ''),
    'with_auxiliaries': ('parameter consumption', '', 'total', 'drivetrain')})
KMH_PER_MPS = 3.6
# Duration of a charging stop if neither file nor parameter names one [s]: from 10 to 80 % at a fast charger.
USUAL_STOP_S = 1500.0
WITH_AUXILIARIES = {'unknown': None, 'total': True, 'drivetrain': False}


@dataclass(frozen=True)
class RouteOffer:
    """
    A mission without its start, its MapLine (None without coordinates) and its length [m].

    `stops` are (index of the segment before it, duration [s]) of each charging stop; `remarks` and `warnings` are
    sentences for the log.
    """

    mission: Mission
    line: MapLine | None
    length_m: float
    vehicle_name: str
    stops: tuple[tuple[int, float], ...]
    remarks: tuple[str, ...]
    warnings: tuple[str, ...]

    def route_plan(self, start_ns: int) -> RoutePlan:
        """Return the RoutePlan of a trip that starts at an instant [ns]."""
        leg = replace(self.mission.legs[0], start_ns=start_ns)
        message = route_plan_message(replace(self.mission, legs=(leg,)))
        message.header.stamp = time_message(start_ns)
        message.stop_after_segment = array('I', [after for after, _ in self.stops])
        message.stop_duration = array('d', [duration_s for _, duration_s in self.stops])
        return message

    def on_route_m(self, on_line_m: float) -> float:
        """Return the distance along the route plan [m], which may be metres longer, of one along the line."""
        if self.line is None:
            return on_line_m
        return self.length_m * (on_line_m / self.line.length_m)


def load_offer(values: Mapping[str, Any]) -> RouteOffer:
    """Return the RouteOffer of parameter values by name; raise InvalidInput if one does not fit."""
    vehicle = load_vehicle(values['vehicle'])
    ambient_c = values['ambient_temperature']
    # Lower than any ambient temperature that a route may have.
    is_given = ambient_c >= LIMITS['ambient_temperature_c'][0]
    loaded = route_for(values['route'], vehicle, options=RouteOptions(
        ambient_c if is_given else None, WITH_AUXILIARIES[values['consumption']],
        known(KMH_PER_MPS * values['free_speed']), known(values['stop_duration']), values['vehicle_id'] or None,
        OFFERS))
    target_c = values['target_battery_temperature']
    is_set = math.isfinite(target_c) and target_c != 0.0
    leg = Leg(loaded.route, charging_planned=values['charging_planned'],
              target_temperature_c=target_c if is_set else None, minimum_arrival_soc=values['minimum_arrival_soc'],
              maximum_arrival_temperature_c=known(values['maximum_arrival_temperature']) or math.inf,
              charger=charger_of(values['charger_power'], values['charging_departure_soc']))
    offer = offer_of(vehicle, loaded, leg, values['route_id'], values['standing_time'])
    return replace(offer, warnings=(*offer.warnings, *unused_in_goal(values)))


def unused_in_goal(values: Mapping[str, Any]) -> list[str]:
    """Return a sentence on each parameter of the goal that is given and has no effect beside the others."""
    of_charging = 'target_battery_temperature', 'maximum_arrival_temperature', 'charger_power'
    unused = dict.fromkeys(() if values['charging_planned'] else of_charging, 'charging_planned is false')
    if 'charger_power' in unused or known(values['charger_power']) is None:
        unused['charging_departure_soc'] = unused.get('charger_power', 'charger_power is not given')
    return [f'{name}: {figure(values[name])} is not used, because {reason}' for name, reason in unused.items()
            if known(values[name]) is not None]


def offer_of(vehicle: Vehicle, loaded: RouteForVehicle, leg: Leg, route_id: str = '',
             standing_time_s: float = 0.0) -> RouteOffer:
    """
    Return the RouteOffer of a loaded route and the requests at its end; raise InvalidInput if they do not fit.

    `route_id` '' is the name of the file without suffix; `standing_time_s` [s] 0: unknown.
    """
    route = loaded.route
    route_id = route_id or loaded.file.stem[:LONGEST_ROUTE_ID]
    problems = route_id_problems(route_id)
    if len(loaded.stops) > MOST_STOPS:
        problems.append(f'route {loaded.file}: has {len(loaded.stops)} charging stops; at most {MOST_STOPS} are '
                        'planned')
    if problems:
        raise InvalidInput(problems)
    check_situation(vehicle, route=route, goal=leg.goal(vehicle.defaults.target_battery_temperature_c))
    warnings = [loaded.warning] if loaded.warning else []
    if loaded.line is None:
        warnings.append(f'route {loaded.file.name} has no coordinates, so fixes cannot be matched; the odometer '
                        'gives the place')
    if not route.distance_m > 0.0:
        warnings.append(f'route {loaded.file.name} has no length, so no place on it is known')
    return RouteOffer(
        Mission(route_id, (leg,), standing_time_s),
        None if loaded.line is None else MapLine(loaded.line), route.distance_m, vehicle.name,
        tuple((stop.after_segment, stop.duration_s if math.isfinite(stop.duration_s) else USUAL_STOP_S)
              for stop in loaded.stops),
        loaded.remarks, tuple(warnings))


def in_words(offer: RouteOffer) -> str:
    """Return an offer in a sentence for the log."""
    route = offer.mission.legs[0].route
    coordinates = 'without coordinates' if offer.line is None else 'with coordinates'
    return (f'Route {offer.mission.route_id!r} for vehicle {offer.vehicle_name}: {offer.length_m / 1000:.1f} km '
            f'in {figure(route.total_duration_s / 60, 4)} min, {coordinates}, {len(offer.stops)} charging stops.')
