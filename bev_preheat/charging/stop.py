# SPDX-License-Identifier: Apache-2.0
"""The inputs of a charging session besides vehicle and battery state: charger, surroundings, departure."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

from bev_preheat.errors import figure, figure_beyond, InvalidInput, share_hint
from bev_preheat.numerics.factors import WH_PER_KWH
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.situation import BatteryState, check_situation
from bev_preheat.vehicle.charging import charging_of

if TYPE_CHECKING:
    from bev_preheat.planning.plan import Plan
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle

# The weakest charger gives more than this; a smaller value is in kilowatts by mistake.
CHARGER_RANGE_W = (1000.0, 2e6)
MOST_SIDE_POWER_W = 50e3
# Fast charging slows down from there, so most stops end there.
USUAL_DEPARTURE_SOC = 0.8
HOTTEST_AMBIENT_C = 60.0


@dataclass(frozen=True)
class Charger:
    """
    A charger as known before the drive: its power [W, at the vehicle's inlet].

    `departure_soc` (0 ... 1) is the state of charge to leave with; None: unknown.
    """

    power_w: float
    departure_soc: float | None = None


@dataclass(frozen=True)
class ChargingStop:
    """
    A stop at a charger: its power [W, at the vehicle's inlet], and the state of charge (0 ... 1) to leave with.

    `ambient_c` [deg C] is the air; `cabin_heating_power_w` and `auxiliary_power_w` [W] are drawn during the
    session.
    """

    charger_power_w: float
    departure_soc: float
    ambient_c: float
    cabin_heating_power_w: float
    auxiliary_power_w: float


def stop_after(route: Route, charger_power_w: float, departure_soc: float) -> ChargingStop:
    """Return the ChargingStop at the end of a Route: air, cabin and auxiliaries as in its last segment."""
    return ChargingStop(charger_power_w, departure_soc, float(route.ambient_temperature_c[-1]),
                        float(route.cabin_heating_power_w[-1]), float(route.auxiliary_power_w[-1]))


def arrival_state(plan: Plan) -> BatteryState:
    """Return the BatteryState on arrival of a Plan, with the heater off as the session requires."""
    if plan.heat is None:
        return BatteryState(plan.arrival_temperature_c, plan.arrival_soc)
    return BatteryState(plan.arrival_temperature_c, plan.arrival_soc,
                        float(plan.heat.heater_power_w[-1]), float(plan.heat.coolant_excess_k[-1]))


def refuse_stranded(plan: Plan) -> None:
    """Raise InvalidInput if the charge is not enough for the unheated drive to the charger."""
    if plan.stranding is not None:
        raise InvalidInput(
            f'state of charge: {100.0 * plan.soc[0]:g} % is not enough for this trip, even without '
            f'heating: the battery will be empty in {duration_text(plan.stranding.at_s)} '
            f'({plan.stranding.deficit_wh / WH_PER_KWH:.2f} kWh short)')


def check_stop(vehicle: Vehicle, stop: ChargingStop, state: BatteryState | None = None) -> None:
    """
    Raise InvalidInput, one sentence per problem, if a session is impossible.

    Vehicle files that do not say whether the car heats while it charges are refused, and so is a
    `state` (BatteryState on arrival) outside the vehicle's model or charged beyond departure.
    """
    charging_of(vehicle)
    battery = vehicle.battery
    problems = [
        f'{name}: {figure_beyond(value, low, high)} is not allowed; it must be {figure(low)} ... '
        f'{figure(high)} {unit}'.rstrip() + (share_hint(value) if high <= 1.0 else '')
        for name, value, (low, high), unit in (
            ('charger power', stop.charger_power_w, CHARGER_RANGE_W, 'W'),
            ('departure state of charge', stop.departure_soc, battery.soc_range,
             "(the vehicle's soc_range)"),
            ('ambient temperature', stop.ambient_c,
             (battery.temperature_range_c[0], HOTTEST_AMBIENT_C), 'degC'),
            ('cabin heating power', stop.cabin_heating_power_w, (0.0, MOST_SIDE_POWER_W), 'W'),
            ('auxiliary power', stop.auxiliary_power_w, (0.0, MOST_SIDE_POWER_W), 'W'))
        if not low <= value <= high]
    if state is not None:
        try:
            check_situation(vehicle, state=state)
        except InvalidInput as error:
            problems += error.problems
        if not problems and state.soc > stop.departure_soc:
            problems.append(
                f'departure state of charge: {stop.departure_soc:g} is below the '
                f'{math.floor(1000.0 * state.soc) / 1000.0:g} that the battery arrives with; it must '
                'be at least that')
    if problems:
        raise InvalidInput(problems)
