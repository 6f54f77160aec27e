# SPDX-License-Identifier: Apache-2.0
"""Extra cost of choosing the target in an update of the planner: at first, during the search, afterwards."""

from __future__ import annotations

from dataclasses import replace
from statistics import median
from time import process_time
from typing import TYPE_CHECKING

from bev_preheat.charging.stop import Charger
from bev_preheat.control.events import BatteryStateArrived, RouteArrived
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.cost.figures import Figure

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

CHARGER = Charger(150e3, 0.8)
# Vehicle, route, and the battery's state at its start.
TRIPS = (('reference', 'reference', BatteryState(-7.0, 0.5)),
         ('large_suv', 'motorway_3h', BatteryState(-15.0, 0.95)))
# Updates after a new route; every search finishes before the last of them.
UPDATES, SEARCHING = 110, slice(1, 40)
SEARCHED = slice(100, UPDATES)
START_NS = 1_000_000 * NS_PER_S


def measure(log: Callable[[str], object]) -> list[Figure]:
    """Return the Figures; `log` takes a line of progress."""
    figures = []
    for vehicle, route, state in TRIPS:
        chosen_s, without_s = (list(_updates_s(vehicle, route, state, charger))
                               for charger in (CHARGER, None))
        what = f'update of the planner on {route}'
        for name, value_s in (
                ('the first with a charger', chosen_s[0]), ('the first without', without_s[0]),
                ('during the search for a target, median', median(chosen_s[SEARCHING])),
                ('during the search for a target, longest', max(chosen_s[SEARCHING])),
                ('after the search, median', median(chosen_s[SEARCHED])),
                ('without a charger, median', median(without_s[SEARCHING])),
                ('without a charger, longest', max(without_s[SEARCHING]))):
            figures.append(Figure(f'{what}, {name}', 1e3 * value_s, 'ms of processor time'))
        log(f'{route}: {len(chosen_s)} updates')
    return figures


def _updates_s(vehicle_name: str, route_name: str, state: BatteryState,
               charger: Charger | None) -> Iterator[float]:
    """Yield the duration of each update, one second apart [s of processor time]."""
    vehicle, settings = load_vehicle(vehicle_name), Settings()
    leg = Leg(load_route(route_name, vehicle.defaults), START_NS)
    mission = Mission(route_name, (replace(leg, charger=charger),)).in_planning_steps(
        settings.planning_step_s)
    supervisor = Supervisor(vehicle, settings)
    supervisor.step(START_NS, RouteArrived(mission))
    for second in range(UPDATES):
        now_ns = START_NS + second * NS_PER_S
        started = process_time()
        supervisor.step(now_ns, BatteryStateArrived(Measurement(state, now_ns)))
        yield process_time() - started
