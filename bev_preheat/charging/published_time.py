# SPDX-License-Identifier: Apache-2.0
"""
The charging time from 10 to 80 % as makers publish it, computed, and a data sheet's curve fitted to it.

Published times hold for a warm battery at a charger that is strong enough, with the cabin heating off.
"""

from __future__ import annotations

from dataclasses import replace
import math

from bev_preheat.charging.session import charge, Session
from bev_preheat.charging.stop import CHARGER_RANGE_W, ChargingStop
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import S_PER_MIN
from bev_preheat.planning.bracketing import halve
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.situation import BatteryState
from bev_preheat.vehicle import Vehicle
from bev_preheat.vehicle.charging import session_charging
from bev_preheat.vehicle.charging_curve import charging_map, FIT_RANGE
from bev_preheat.vehicle.chemistry import load_chemistry
from bev_preheat.vehicle.data_sheet import DataSheet
from bev_preheat.vehicle.data_sheet_import import curves_of, describe_car, Entry
from bev_preheat.vehicle.loading import vehicle_of_text
from bev_preheat.vehicle.writing import vehicle_text

USUAL_WARM_C = 25.0
AIR_C = 20.0
PUBLISHED_SPAN = (0.1, 0.8)
# Factor of a published curve beyond which curve and time do not belong to one car.
CURVE_FACTOR_RANGE = (0.8, 1.25)
# The fit's range is halved until a time is met far below the digits of data sheets.
TIME_HALVINGS = 20


def warm_session(vehicle: Vehicle, span: tuple[float, float] = PUBLISHED_SPAN,
                 battery_c: float = USUAL_WARM_C) -> Session:
    """
    Return the Session of a Vehicle between two states of charge (0 ... 1) at an unlimited charger.

    `battery_c` is the battery temperature at its start [deg C]; the air has AIR_C, or `battery_c` if it is colder.
    The cabin is not heated, and a car whose file does not say whether it heats its battery does not. States of
    charge outside the vehicle's soc_range are cut off.
    """
    low, high = vehicle.battery.soc_range
    start, end = (min(max(soc, low), high) for soc in span)
    car = replace(vehicle, charging=session_charging(vehicle))
    stop = ChargingStop(CHARGER_RANGE_W[1], end, min(AIR_C, battery_c), 0.0, vehicle.defaults.auxiliary_power_w)
    return charge(car, stop, BatteryState(battery_c, start))


def describe_timed_car(sheet: DataSheet) -> dict[str, Entry]:
    """
    Return the entries of a vehicle file as `describe_car`, with the curve fitted to the published time if any.

    Raises InvalidInput if the data sheet is implausible, or if no fit gives the time.
    """
    entries = describe_car(sheet)
    if sheet.charging_time_10_80_min is None:
        return entries
    chemistry = load_chemistry(sheet.chemistry)
    vehicle = vehicle_of_text(vehicle_text(sheet.name, entries, ''), sheet.name)
    wanted_s = S_PER_MIN * sheet.charging_time_10_80_min

    def time_s(fit: float) -> float:
        table = charging_map(curves_of(sheet, fit), chemistry, sheet.charging_power_kw, sheet.charging_limit)
        charging = session_charging(vehicle)
        return warm_session(replace(vehicle, charging=replace(
            charging, power_limit=table))).charging_time_s

    slow, fast = CURVE_FACTOR_RANGE if sheet.charging_curves else FIT_RANGE
    shortest_s, longest_s = time_s(fast), time_s(slow)
    if not shortest_s <= wanted_s <= longest_s:
        raise InvalidInput(_unfit(sheet, time_s(1.0), shortest_s, longest_s))
    return describe_car(sheet, math.exp(halve(
        math.log(fast), math.log(slow), lambda fit: time_s(math.exp(fit)) <= wanted_s, TIME_HALVINGS)))


def _unfit(sheet: DataSheet, usual_s: float, shortest_s: float, longest_s: float) -> str:
    low, high = (f'{seconds / S_PER_MIN:.1f}' for seconds in (shortest_s, longest_s))
    start = f'--charging-time-10-80-min: {sheet.charging_time_10_80_min:g} min'
    if sheet.charging_curves:
        return (f'{start} does not fit --charging-curve, which takes {duration_text(usual_s)}; {low} ... {high} '
                'min are allowed. Do both belong to one car?')
    return (f'{start} does not fit --charging-power-kw {sheet.charging_power_kw:g} kW; it must be {low} ... '
            f'{high} min. Give the maximum power and the time of one car')
