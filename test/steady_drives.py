# SPDX-License-Identifier: Apache-2.0
"""A leg of a steady drive in winter towards a charger, and battery states, for tests of the planner."""

from bev_preheat.control.decision import Moment
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
NOW_NS = 1_700_000_000 * NS_PER_S
COLUMNS = {'speed_mps': [20.0], 'propulsion_power_w': [20e3], 'ambient_temperature_c': [-7.0],
           'cabin_heating_power_w': [1500.0], 'auxiliary_power_w': [400.0]}


def ns(seconds):
    return round(seconds * NS_PER_S)


def at(seconds):
    """Return the instant [ns] some seconds after NOW_NS."""
    return NOW_NS + round(seconds * NS_PER_S)


def steady_leg(duration_s=1200.0, step_s=30.0, **changes):
    """
    Return a Leg from NOW_NS on, by default too short for its 25 degC, so that a cold battery is heated at once.

    `changes` are columns of the route, or fields of the Leg.
    """
    columns = {name: changes.pop(name, values) for name, values in COLUMNS.items()}
    columns['duration_s'] = [step_s] * round(duration_s / step_s)
    return Leg(make_route(columns, VEHICLE.defaults), **{
        'start_ns': NOW_NS, 'target_temperature_c': 25.0, **changes})


def steady_mission(route_id='home', **leg):
    return Mission(route_id, (steady_leg(**leg),))


def measured(now_ns=NOW_NS, temperature_c=-7.0, soc=0.8, stamp_ns=None):
    """Return the Measurement of a battery state that comes now, by default with the stamp of now."""
    return Measurement(BatteryState(temperature_c, soc), now_ns if stamp_ns is None else stamp_ns)


def outcome(supervisor, now_ns=NOW_NS):
    """Return power [W] and reason of a Stepwise planner's command."""
    command = supervisor.command(now_ns)
    return command.battery_heating_power_w, command.reason


def moment_of(state, **changes):
    """Return the Moment of a State with other fields."""
    return Moment(**dict(zip(Moment.__annotations__, state.moment)) | changes)
