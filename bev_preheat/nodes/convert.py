# SPDX-License-Identifier: Apache-2.0
"""
Convert messages to the types of planning and back, and validate units and shapes.

Messages carry SI units and degrees Celsius, as the types do; only energies are in Wh.
"""

from __future__ import annotations

from array import array
import math
from typing import TYPE_CHECKING

from builtin_interfaces.msg import Time
import numpy as np
from sensor_msgs.msg import Temperature

from bev_preheat.control.events import BatteryStateArrived, BatteryStateUnreadable
from bev_preheat.control.inputs import Leg, Measurement, Mission, with_stops
from bev_preheat.errors import figure_beyond, InvalidInput, quoted
from bev_preheat.nodes.battery_fields import (
    read_percentage,
    read_supply_status,
    read_temperatures,
    read_voltage_and_current,
)
from bev_preheat.nodes.chargers import (
    charger_from_message,
    charger_problems,
    prospect_from_message,
    write_charger,
    write_prospect,
)
from bev_preheat.nodes.route_powers import GIVEN, powers_of_road_load, slope_problems, without_powers
from bev_preheat.nodes.stops import STOP_FIELDS, stops_from_message, write_stops
from bev_preheat.nodes.target_report import write_target
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route.segments import make_route, MOST_SEGMENTS
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike
    from sensor_msgs.msg import BatteryState as BatteryStateMessage

    from bev_preheat.control.decision import Command, Decision
    from bev_preheat.nodes.stops import PlannedStop
    from bev_preheat.planning.outcome import Stranding
    from bev_preheat.planning.plan import Plan
    from bev_preheat.route import Route
    from bev_preheat.vehicle.description import Defaults, Vehicle

# The last second that a builtin_interfaces/Time can hold.
LAST_TIME_S = 2**31 - 1
# Repeated in every plan and log line.
LONGEST_ROUTE_ID = 256
# Fields of Route and of RoutePlan.
ROUTE_FIELDS = {
    'duration_s': 'segment_duration',
    'speed_mps': 'speed',
    'propulsion_power_w': 'propulsion_power',
    'propulsion_power_rms_w': 'propulsion_power_rms',
    'ambient_temperature_c': 'ambient_temperature',
    'cabin_heating_power_w': 'cabin_heating_power',
    'auxiliary_power_w': 'auxiliary_power',
    'propulsion_power_magnitude_w': 'propulsion_power_magnitude',
}
# Fields of Energies and of PreheatPlan.
ENERGY_FIELDS = {
    'joule': 'joule_energy',
    'drivetrain_heat': 'drivetrain_heat_energy',
    'hvch_electric': 'hvch_electric_energy',
    'hvch_heat': 'hvch_heat_energy',
    'leakage': 'leakage_energy',
    'battery_total': 'battery_energy',
}


def nanoseconds(stamp: Time) -> int:
    """Nanoseconds of a builtin_interfaces/Time."""
    return stamp.sec * NS_PER_S + stamp.nanosec


def time_message(instant_ns: int) -> Time:
    """Return the builtin_interfaces/Time of an instant [ns]."""
    return Time(sec=instant_ns // NS_PER_S, nanosec=instant_ns % NS_PER_S)


def measurement_from_message(message: BatteryStateMessage) -> Measurement:
    """Return the Measurement of a sensor_msgs/BatteryState; raise InvalidInput on unknown values."""
    problems: list[str] = []
    temperatures = read_temperatures(message, problems)
    soc = read_percentage(message, problems)
    problems += stamp_problems(message.header.stamp)
    if problems:
        raise InvalidInput(problems)
    voltage_v, current_a = read_voltage_and_current(message)
    return Measurement(
        BatteryState(temperatures.battery_c, soc), nanoseconds(message.header.stamp), voltage_v, current_a,
        coldest_cell_c=temperatures.coldest_cell_c, cell_spread_k=temperatures.cell_spread_k,
        supply_status=read_supply_status(message),
        location=message.location, serial_number=message.serial_number)


def battery_event(message: BatteryStateMessage,
                  hint: str = '') -> BatteryStateArrived | BatteryStateUnreadable:
    """Return the event of a sensor_msgs/BatteryState; `hint` is added to a refusal."""
    try:
        return BatteryStateArrived(measurement_from_message(message), hint)
    except InvalidInput as error:
        return BatteryStateUnreadable(InvalidInput([*error.problems, hint]) if hint else error,
                                      float(message.percentage))


def is_cancellation(message: RoutePlan) -> bool:
    """
    Return whether a RoutePlan cancels the trip: no charging planned, no segments and no stops.

    Its other fields, the stamp included, are ignored.
    """
    return not message.charging_planned and not any(
        len(getattr(message, field)) for field in (*ROUTE_FIELDS.values(), 'slope', *STOP_FIELDS))


def mission_from_message(message: RoutePlan, defaults: Defaults, planning_step_s: float,
                         vehicle: Vehicle | None = None) -> Mission:
    """
    Return the Mission of a RoutePlan, its legs in steps of `planning_step_s` seconds or longer.

    `defaults` (vehicle.description.Defaults) fill in fields that the message leaves open, the road load of
    `vehicle`
    the propulsion power. Raises InvalidInput with one problem per field.
    """
    _check_sizes(message)
    problems = stamp_problems(message.header.stamp)
    soc = message.minimum_arrival_soc
    if not 0.0 <= soc <= 1.0:
        problems.append(f'minimum_arrival_soc: {figure_beyond(soc, 0.0, 1.0)} is not allowed; it must be 0 ... 1')
    if not 0.0 <= message.standing_time < math.inf:
        problems.append(f'standing_time: {message.standing_time:g} is not allowed; it must be '
                        'finite and at least 0 s (0: not known)')
    problems += _target_problems(message) + charger_problems(message) + slope_problems(message)
    columns = {field: np.asarray(getattr(message, name), dtype=float)
               for field, name in ROUTE_FIELDS.items()}
    route: Route | None = None
    stops: tuple[PlannedStop, ...] = ()
    power_source = GIVEN
    try:
        if vehicle is not None and without_powers(columns) and not problems:
            columns, power_source = powers_of_road_load(message, columns, vehicle)
        route = make_route(columns, defaults, ROUTE_FIELDS, tells_units=True)
    except InvalidInput as error:
        problems += error.problems
    try:
        stops = stops_from_message(message, None if route is None else len(route),
                                   defaults.target_battery_temperature_c)
    except InvalidInput as error:
        problems += error.problems
    if route is not None and (message.header.stamp.sec + route.total_duration_s
                              + sum(stop.duration_s for stop in stops) > LAST_TIME_S):
        problems.append(f'header.stamp: {message.header.stamp.sec} s is too late: the route '
                        'would end after the last instant that a stamp can hold')
    if problems or route is None:
        raise InvalidInput(problems)
    return Mission(message.route_id, _legs(message, route, stops, planning_step_s),
                   message.standing_time, power_source=power_source)


def _check_sizes(message: RoutePlan) -> None:
    """Raise InvalidInput if the message is too large for further checks."""
    problems = [f'{name}: has {len(getattr(message, name))} values; at most {MOST_SEGMENTS} '
                'segments are planned'
                for name in (*ROUTE_FIELDS.values(), 'slope') if len(getattr(message, name)) > MOST_SEGMENTS]
    if len(message.route_id) > LONGEST_ROUTE_ID:
        problems.append(f'route_id: {quoted(message.route_id)} is too long; it must have at most '
                        f'{LONGEST_ROUTE_ID} characters')
    if problems:
        raise InvalidInput(problems)


def _target_problems(message: RoutePlan) -> list[str]:
    target_c = message.target_battery_temperature
    if message.has_target_battery_temperature and not math.isfinite(target_c):
        return [f'target_battery_temperature: {target_c:g} is not allowed where '
                'has_target_battery_temperature is true; it must be finite']
    if math.isinf(target_c):
        return [f'target_battery_temperature: {target_c:g} is not allowed; it must be finite, or '
                "0 or NaN: the planner's own default"]
    return []


def _target_c(message: RoutePlan) -> float | None:
    """Return the target [deg C] of a valid RoutePlan; None: not given."""
    target_c = message.target_battery_temperature
    is_given = message.has_target_battery_temperature or not (target_c == 0.0 or
                                                              math.isnan(target_c))
    return target_c if is_given else None


def _legs(message: RoutePlan, route: Route, stops: Sequence[PlannedStop],
          planning_step_s: float) -> tuple[Leg, ...]:
    """Return the Legs between the stops of a valid RoutePlan."""
    edges = [0, *(stop.after_segment + 1 for stop in stops), len(route)]
    goals = [*((True, stop.target_temperature_c, stop.minimum_arrival_soc) for stop in stops),
             (message.charging_planned, _target_c(message), message.minimum_arrival_soc)]
    departures = [None, *(stop.departure for stop in stops)]
    chargers = [*(stop.charger for stop in stops), charger_from_message(message)]
    prospects = [*(stop.prospect for stop in stops), prospect_from_message(message)]
    start_ns, legs = nanoseconds(message.header.stamp), []
    for first, end, goal, departure, charger, prospect in zip(
            edges, edges[1:], goals, departures, chargers, prospects):
        charging_planned, target_c, minimum_soc = goal
        legs.append(Leg(route.segments(first, end), start_ns, charging_planned, target_c, minimum_soc, departure,
                        charger=charger, prospect=prospect).in_planning_steps(planning_step_s))
    return with_stops(legs, [stop.duration_s for stop in stops])


def stamp_problems(stamp: Time) -> list[str]:
    """Return the problems of a header's stamp as sentences."""
    if stamp.sec == 0 and stamp.nanosec == 0:
        return ['header.stamp: is 0; it must be set, as "header: auto" of ros2 topic pub does']
    if stamp.nanosec >= NS_PER_S:
        return [f'header.stamp.nanosec: {stamp.nanosec} is not allowed; it must be below '
                f'{NS_PER_S}']
    return []


def route_plan_message(mission: Mission) -> RoutePlan:
    """Return the RoutePlan of a Mission."""
    message = RoutePlan(route_id=mission.route_id, standing_time=mission.standing_time_s)
    message.header.stamp = time_message(mission.start_ns)
    for field, name in ROUTE_FIELDS.items():
        setattr(message, name, _sequence(np.concatenate(
            [getattr(leg.route, field) for leg in mission.legs])))
    write_stops(message, mission.legs)
    last = mission.legs[-1]
    message.charging_planned = last.charging_planned
    message.has_target_battery_temperature = last.target_temperature_c is not None
    message.target_battery_temperature = last.target_temperature_c or 0.0
    message.minimum_arrival_soc = last.minimum_arrival_soc
    write_charger(message, last.charger)
    write_prospect(message, last.prospect)
    return message


def command_message(command: Command, now_ns: int) -> HvchCommand:
    """Return the HvchCommand of a Command made now."""
    message = HvchCommand()
    # Filled in place, because rclpy creates the parts of a message anyway and the heater waits for this one.
    stamp, valid_until = message.header.stamp, message.valid_until
    stamp.sec, stamp.nanosec = divmod(now_ns, NS_PER_S)
    valid_until.sec, valid_until.nanosec = divmod(command.valid_until_ns, NS_PER_S)
    message.battery_heating_power = command.battery_heating_power_w
    message.reason = int(command.reason)
    return message


def plan_message(decision: Decision, mission: Mission | None, now_ns: int,
                 later_decisions: Sequence[Decision] = ()) -> PreheatPlan:
    """
    Return the PreheatPlan of a Decision; without a plan its figures are NaN.

    `later_decisions` are for the legs after the next stop.
    """
    plan = decision.plan
    message = PreheatPlan(route_id=mission.route_id if mission else '',
                          status=int(decision.status), explanation=decision.explanation)
    start_ns = decision.plan_start_ns if plan else now_ns
    message.header.stamp = time_message(start_ns)
    message.delay = mission.delay_ns / NS_PER_S if mission else 0.0
    message.propulsion_power_source = mission.power_source if mission else ''
    _write_later(message, later_decisions)
    write_target(message, decision.target)
    if plan is None:
        for field in ('predicted_arrival_temperature', 'predicted_arrival_temperature_deviation',
                      'predicted_arrival_soc', 'shortfall', 'target_battery_temperature',
                      'soc_shortfall', 'undeliverable_power', 'charge_runs_out_distance',
                      'lacking_energy',
                      *ENERGY_FIELDS.values()):
            setattr(message, field, math.nan)
        return message
    message.method = plan.method
    message.heating_planned = plan.heating_start_s is not None
    message.heating_start, message.arrival = _heating_and_arrival(decision)
    message.heating_end = _heating_end(decision, plan, message.arrival)
    message.predicted_arrival_temperature = plan.arrival_temperature_c
    message.predicted_arrival_temperature_deviation = decision.arrival_deviation_k
    message.predicted_arrival_soc = plan.arrival_soc
    message.target_battery_temperature = plan.target_temperature_c
    message.shortfall = plan.shortfall_k
    message.soc_shortfall = plan.soc_shortfall
    message.undeliverable_power = plan.undeliverable_power_w
    _write_stranding(message, plan.stranding, start_ns)
    for field, name in ENERGY_FIELDS.items():
        setattr(message, name, getattr(plan.energy_wh, field))
    message.time = _sequence(plan.time_s)
    message.battery_temperature = _sequence(plan.battery_temperature_c)
    message.soc = _sequence(plan.soc)
    message.hvch_power = _sequence(plan.hvch_battery_power_w)
    if plan.heat is not None:
        message.heater_power = _sequence(plan.heat.heater_power_w)
        message.coolant_excess_temperature = _sequence(plan.heat.coolant_excess_k)
    message.stretch_start = _sequence([interval.start_s for interval in plan.intervals])
    message.stretch_end = _sequence([interval.end_s for interval in plan.intervals])
    message.stretch_energy = _sequence([interval.energy_wh for interval in plan.intervals])
    message.stretch_reason = bytes(int(interval.reason) for interval in plan.intervals)
    message.model_factors = _sequence(decision.model_factors)
    message.planning_time = plan.planning_time_s
    return message


def _write_stranding(message: PreheatPlan, stranding: Stranding | None, start_ns: int) -> None:
    message.charge_runs_out_distance = message.lacking_energy = math.nan
    if stranding is not None:
        message.charge_runs_out = time_message(start_ns + round(stranding.at_s * NS_PER_S))
        message.charge_runs_out_distance = stranding.at_m
        message.lacking_energy = stranding.deficit_wh


def _write_later(message: PreheatPlan, decisions: Sequence[Decision]) -> None:
    plans = [decision.plan for decision in decisions]
    instants = [_heating_and_arrival(decision) for decision in decisions]
    message.later_heating_start = [heating_start for heating_start, _ in instants]
    message.later_arrival = [arrival for _, arrival in instants]
    message.later_predicted_arrival_temperature = [
        plan.arrival_temperature_c if plan else math.nan for plan in plans]
    message.later_predicted_arrival_soc = [
        plan.arrival_soc if plan else math.nan for plan in plans]
    message.later_status = bytes(int(decision.status) for decision in decisions)


def _heating_and_arrival(decision: Decision) -> tuple[Time, Time]:
    """Return the instants of a decision's plan as Time messages; 0: none."""
    plan = decision.plan
    return tuple(
        Time() if after_s is None else
        time_message(decision.plan_start_ns + round(after_s * NS_PER_S))
        for after_s in ((plan.heating_start_s, plan.arrival_time_s) if plan else (None, None)))


def _heating_end(decision: Decision, plan: Plan, arrival: Time) -> Time:
    """Return the instant at which heating ends for good as a Time message; 0: no heating."""
    if plan.heating_start_s is None:
        return Time()
    if plan.heating_end_s is None:
        return arrival
    return time_message(decision.plan_start_ns + round(plan.heating_end_s * NS_PER_S))


def temperature_message(decision: Decision, now_ns: int) -> Temperature:
    """Return the predicted arrival temperature of a Decision; variance 0 means unknown."""
    plan, deviation_k = decision.plan, decision.arrival_deviation_k
    if plan is None:
        raise ValueError('without a plan no arrival is predicted')
    message = Temperature(temperature=plan.arrival_temperature_c,
                          variance=0.0 if math.isnan(deviation_k) else deviation_k**2)
    message.header.stamp = time_message(now_ns)
    return message


def _sequence(values: ArrayLike) -> array[float]:
    """Return an array as rclpy takes it without a copy of each element."""
    sequence = array('d')
    sequence.frombytes(np.ascontiguousarray(values, dtype=float).tobytes())
    return sequence
