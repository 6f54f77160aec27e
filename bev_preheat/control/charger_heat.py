# SPDX-License-Identifier: Apache-2.0
"""
Heating while the vehicle charges, if the integrator asks for it, the vehicle is able to, and it pays.

Whether and up to which temperature it pays is the choice of `charging.heating_choice` from the battery's state:
the price of the energy against the value of the time at the charger. The choice is made at the charger and
again every SEARCH_PERIOD_S, and as soon as the charger's power has changed. The charger feeds the heater while
it also charges the battery. This shows in the battery's own power, so heating at the charger needs voltage and
current.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.charging.equations import heated_c
from bev_preheat.charging.heating_choice import ChargerHeating, HeatingChoice, HeatingDecision
from bev_preheat.charging.stop import Charger, CHARGER_RANGE_W, stop_after, USUAL_DEPARTURE_SOC
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import FLOATS, NS_PER_S, W_PER_KW
from bev_preheat.tunables import BEGINS_BELOW_K, CHANGED_POWER, CHARGER_RAMP_S, LIMITING_SHARE, SEARCH_PERIOD_S

if TYPE_CHECKING:
    from bev_preheat.charging.target_worth import Prices
    from bev_preheat.control.inputs import Leg, Measurement
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.vehicle.description import Vehicle


class ChargerHeat(NamedTuple):
    """Power to command while the vehicle charges [W], and the reason as a sentence."""

    power_w: float
    reason: str


@dataclass(frozen=True, eq=False)
class ChargerSituation:
    """
    A vehicle that charges after, or on, a Leg.

    `vehicle` is the corrected one, `state` is the estimated BatteryState at the Measurement.
    `charger` is the Charger as the route plan knows it; None: unknown. `is_heating`: the heater is on.
    """

    vehicle: Vehicle
    leg: Leg
    measurement: Measurement
    state: BatteryState
    prices: Prices
    charger: Charger | None = None
    is_heating: bool = False

    @property
    def heater_w(self) -> float:
        """The heater power that the cabin leaves [W]."""
        return max(0.0, self.vehicle.hvch.maximum_power_w - float(self.leg.route.cabin_heating_power_w[-1]))

    @property
    def heated_c(self) -> float:
        """The battery temperature with the heat under way [deg C], by which the car switches."""
        return float(heated_c(self.vehicle, self.state.temperature_c, self.state.heater_power_w,
                              self.state.coolant_excess_k))

    @property
    def departure_soc(self) -> float:
        """State of charge to leave with."""
        known = None if self.charger is None else self.charger.departure_soc
        return USUAL_DEPARTURE_SOC if known is None else known


@dataclass(frozen=True, eq=False)
class ChargerHeater:
    """
    Decides on the heating at one charger after another; a value.

    `choice` is the HeatingChoice that holds, made at `made_ns` [ns] for what `key` says and a charger's power of
    `power_w` [W]; None before the first.
    """

    key: tuple[object, ...] = ()
    choice: HeatingChoice | None = None
    made_ns: int = 0
    power_w: float = 0.0

    def heat(self, now: ChargerSituation) -> tuple[ChargerHeater, ChargerHeat]:
        """
        Return the ChargerHeat in a ChargerSituation, and the ChargerHeater that has decided on it.

        The heater gets all the power that the cabin leaves, up to the temperature up to which heating pays. It is
        switched on if the battery is charged with more power than the heater will take, and off once the battery
        is no longer charged.
        """
        obstacle = _obstacle(now)
        if obstacle:
            return self, ChargerHeat(0.0, f'No heating: {obstacle}.')
        try:
            heater, choice = self._chosen(now)
        except (InvalidInput, ArithmeticError) as error:
            return replace(self, key=()), ChargerHeat(
                0.0, f'No heating: its worth is unknown: {str(error).rstrip(".")}.')
        heated_below_c = now.vehicle.charging.heated_below_c if now.vehicle.charging else -math.inf
        limit_c, temperature_c = choice.limit.function(heated_below_c)(now.state.soc), now.heated_c
        if temperature_c >= limit_c - (0.0 if now.is_heating else BEGINS_BELOW_K):
            return heater, ChargerHeat(0.0, f'No heating: {heater._why_not(choice, limit_c, temperature_c)}.')
        return heater, ChargerHeat(now.heater_w, f'Heating with {now.heater_w:.0f} W up to {limit_c:.1f} degC'
                                   f'{_why(choice)}.')

    def _chosen(self, now: ChargerSituation) -> tuple[ChargerHeater, HeatingChoice]:
        """Return the HeatingChoice that holds, a new one if that is due."""
        power_w = _charger_power_w(now)
        stop = stop_after(now.leg.route, power_w, now.departure_soc)
        key = replace(stop, charger_power_w=0.0), now.charger, now.prices
        elapsed_s = abs(now.measurement.stamp_ns - self.made_ns) / NS_PER_S
        is_due = key != self.key or elapsed_s >= SEARCH_PERIOD_S or (
            elapsed_s >= CHARGER_RAMP_S and abs(power_w - self.power_w) > CHANGED_POWER * self.power_w)
        if self.choice is not None and not is_due:
            return self, self.choice
        choice = ChargerHeating(now.vehicle, stop, now.prices).compare(now.state)
        return ChargerHeater(key, choice, now.measurement.stamp_ns, power_w), choice

    def _why_not(self, choice: HeatingChoice, limit_c: float, temperature_c: float) -> str:
        if choice.decision is HeatingDecision.NEVER:
            more = choice.cost_always - choice.cost
            return (f'with {self.power_w / W_PER_KW:.0f} kW here it would cost '
                    + (f'{more:.2f} more than it saves' if math.isfinite(more) else 'more than it saves'))
        return f'at {temperature_c:.1f} degC the battery is warm enough' + (
            '' if choice.decision is HeatingDecision.ALWAYS or temperature_c < limit_c
            else ', and more heat would cost more than it saves')


def _why(choice: HeatingChoice) -> str:
    """Return what heating saves, to append to a sentence."""
    if choice.problem_never is not None and math.isfinite(choice.cost):
        return (f': heated it reaches {100.0 * float(choice.session.soc[-1]):.0f} % in '
                f'{choice.session.charging_time_s / 60.0:.0f} min, unheated never')
    if choice.decision is HeatingDecision.LIMITED:
        return '; more heat would cost more than it saves'
    return ''


def _obstacle(now: ChargerSituation) -> str:
    """Return why heating is out of the question; '' if it is to be weighed."""
    charging, power_w = now.vehicle.charging, now.measurement.power_w
    if not now.leg.charging_planned:
        return 'no charging is planned here'
    if charging is None or not charging.battery_heating:
        return 'the vehicle file does not say that the vehicle heats its battery while it charges'
    temperature_c = now.heated_c
    if temperature_c >= charging.heated_below_c - (0.0 if now.is_heating else BEGINS_BELOW_K):
        return f'at {temperature_c:.1f} degC the battery is warm enough'
    if power_w is None:
        return 'battery_state does not say whether the battery is being charged'
    if now.heater_w == 0.0:
        return 'the cabin takes the whole heater power'
    if -power_w <= (0.0 if now.is_heating else now.heater_w):
        return f'the battery is charged with {max(0.0, -power_w):.0f} W, and the heater takes {now.heater_w:.0f} W'
    if now.state.soc >= now.departure_soc:
        return f'the battery has the {100.0 * now.departure_soc:.0f} % to leave with'
    return ''


def _charger_power_w(now: ChargerSituation) -> float:
    """
    Return the charger's power at the inlet [W], as known and as seen.

    If the battery takes less than its limit allows, the charger gives no more than it does now. Otherwise it may
    give more: its power as known from the route plan, or without that all that the inlet takes.
    """
    charging, measured_w = now.vehicle.charging, now.measurement.power_w
    assert charging is not None and measured_w is not None
    route, taken_w = now.leg.route, -measured_w
    seen_w = (taken_w + float(route.cabin_heating_power_w[-1]) + float(route.auxiliary_power_w[-1])
              + (now.heater_w if now.is_heating else 0.0))
    limit_w = -charging.power_limit.function(FLOATS)(now.state.soc, now.state.temperature_c)
    known_w = charging.maximum_inlet_power_w if now.charger is None else now.charger.power_w
    power_w = max(known_w, seen_w) if taken_w >= LIMITING_SHARE * limit_w else min(known_w, seen_w)
    return min(max(power_w, CHARGER_RANGE_W[0]), CHARGER_RANGE_W[1])
