# SPDX-License-Identifier: Apache-2.0
"""
A charging session: the model's own equations, with the terminal power that charger and battery allow.

    P_b = min(P_max - P_aux - P_cabin - P_h - P_c, |P_limit(s, T)|) >= 0     into the battery's terminals
    P_h = P_hvch_max - P_cabin while the car heats at the charger and T_h is below its limit, else 0
    P_c   of the active cooling, by the battery temperature (`equations.make_cooling`)

T_h is the battery temperature with the heat under way (`equations.heated_c`): T itself if heat arrives at once.
P_max is the power of charger and inlet. Cabin and auxiliaries are served first, then heater and cooling, which
give way at a weak charger, then the battery. The limit of heating is the car's own, or lower: a `HeatingLimit`
over the state of charge, which `heating_choice` chooses. Equations, integrator and heat path are those of
`vehicle`; only the power is chosen here, at each stage of a step. Steps end when heating ends and when the
departure's state of charge is reached.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Any, NamedTuple

import numpy as np

from bev_preheat.charging.ageing import AgeingCost, session_ageing
from bev_preheat.charging.equations import (
    charging_power,
    heated_c,
    heater_power_of,
    make_charging_rates,
    make_charging_step,
    make_cooling,
    supply_of,
)
from bev_preheat.charging.heating_policy import ALWAYS, HeatingLimit
from bev_preheat.charging.stop import ChargingStop, check_stop
from bev_preheat.numerics import FloatArray, FLOATS, JOULES_PER_WH
from bev_preheat.planning.bracketing import close_in, follow_slope, halve, Trial
from bev_preheat.planning.heat_run import heated_heat_capacity_j_per_k
from bev_preheat.planning.situation import BatteryState
from bev_preheat.tunables import TIME_CONSTANT_SHARE
from bev_preheat.vehicle.charging import charging_of, vehicle_at_charger
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.heat_path import make_heat_step
from bev_preheat.vehicle.model import hottest_c, idle_heat_w, make_rates

# Longest step [s], and the largest share of the charge in a step.
STEP_S = 20.0
STEP_SOC = 0.005
# While the temperature is held only the state of charge changes: steps may be longer by this factor.
HELD_STEPS = 3.0
# Longest session [s].
LONGEST_SESSION_S = 24.0 * 3600.0
# Less than this [W] into the battery does not count as charging.
CHARGES_FROM_W = 50.0
# Number of temperatures, between now and the settled state, at which to check whether power comes back.
OUTLOOK_POINTS = 101
# Steps end this close to their end temperature [K] and state of charge.
TEMPERATURE_TOLERANCE_K = 1e-6
STEP_SOC_TOLERANCE = 1e-12
# A battery that is short by less state of charge than this counts as charged.
DEFICIT_SOC = 1e-9
MOST_STEP_TRIALS = 60
SETTLING_HALVINGS = 30


@dataclass(frozen=True)
class SessionEnergies:
    """
    Energies of a session [Wh].

    `bought` goes to `terminal` (into the battery's terminals), `hvch_electric`, `cooling_electric`, `cabin` and
    `auxiliary`. Of `terminal`, `joule` becomes heat and `stored` charge (the integral of U_oc dQ). Heat of the
    battery: `joule`, `hvch_heat` and `leakage`, which is negative where heat is lost, less `cooling_heat`.
    """

    bought: float
    terminal: float
    stored: float
    joule: float
    hvch_electric: float
    hvch_heat: float
    cabin: float
    auxiliary: float
    leakage: float
    cooling_electric: float = 0.0
    cooling_heat: float = 0.0


@dataclass(frozen=True, eq=False)
class Session:
    """
    A charging session; times in seconds after plugging in.

    `problem` explains why it does not reach the departure's state of charge, or is None. Shapes: `time_s`,
    `battery_temperature_c` and `soc` (N + 1,); `charging_power_w` (into the terminals), `hvch_battery_power_w`
    and `cooling_power_w` (electrical) (N,), the mean in each step [W]. `ageing` is the AgeingCost, None if the
    vehicle file does not price it.
    """

    problem: str | None
    time_s: FloatArray
    battery_temperature_c: FloatArray
    soc: FloatArray
    charging_power_w: FloatArray
    hvch_battery_power_w: FloatArray
    cooling_power_w: FloatArray
    energy_wh: SessionEnergies
    ageing: AgeingCost | None = None

    @property
    def charging_time_s(self) -> float:
        """Time to the departure's state of charge [s]; infinite if it is never reached."""
        return float(self.time_s[-1]) if self.problem is None else math.inf

    @property
    def bought_energy_wh(self) -> float:
        """Energy bought until then [Wh]; infinite if the session never ends."""
        return self.energy_wh.bought if self.problem is None else math.inf

    @property
    def ageing_cost(self) -> float:
        """Cost of the ageing until then, 0 if it is not priced; infinite if the session never ends."""
        return 0.0 if self.ageing is None else self.ageing.cost if self.problem is None else math.inf

    def as_dictionary(self) -> dict[str, Any]:
        """Return the session as JSON-compatible numbers, texts and lists."""
        return {
            'problem': self.problem,
            'arrival_temperature_c': float(self.battery_temperature_c[0]),
            'arrival_soc': float(self.soc[0]),
            'charging_time_s': self.charging_time_s,
            'bought_energy_wh': self.bought_energy_wh,
            'departure_temperature_c': float(self.battery_temperature_c[-1]),
            'departure_soc': float(self.soc[-1]),
            'energy_wh': dict(vars(self.energy_wh)),
            **({} if self.ageing is None else {'ageing': self.ageing._asdict()}),
            **{name: getattr(self, name).tolist() for name in (
                'time_s', 'battery_temperature_c', 'soc', 'charging_power_w', 'hvch_battery_power_w',
                'cooling_power_w')}}


class _Step(NamedTuple):
    """One step: its end, its duration [s], and the means of powers [W] and of the battery temperature [deg C]."""

    duration_s: float
    end: BatteryState
    terminal_w: float
    drawn_w: float
    arriving_w: float
    leakage_w: float
    cooling_w: float
    cooled_w: float


def charge(vehicle: Vehicle, stop: ChargingStop, state: BatteryState, step_s: float = STEP_S,
           heating: HeatingLimit = ALWAYS) -> Session:
    """
    Return the Session of a vehicle that arrives at a ChargingStop with a BatteryState.

    A car that is able to heats its battery up to a HeatingLimit, and never above its own limit. The session is
    simulated in steps of at most `step_s` [s]. A session that cannot reach the departure's
    state of charge ends with a `problem`, after LONGEST_SESSION_S at the latest. Raises InvalidInput
    if vehicle, stop or state are not allowed (`stop.check_stop`).
    """
    check_stop(vehicle, stop, state)
    plug = _Plug(vehicle, stop, step_s, heating)
    now, states, steps, elapsed_s, problem = state, [state], [], 0.0, None
    while problem is None and stop.departure_soc - now.soc > DEFICIT_SOC:
        problem = plug.problem_at(now)
        if problem is None and elapsed_s >= LONGEST_SESSION_S:
            problem = (f'the battery has only {100.0 * now.soc:.1f} % after '
                       f'{LONGEST_SESSION_S / 3600.0:.0f} h')
        if problem is None:
            step = plug.step_from(now)
            now, elapsed_s = step.end, elapsed_s + step.duration_s
            states.append(now)
            steps.append(step)
    return _session(vehicle, stop, problem, states, steps)


class _Plug:
    """One vehicle at one charger: the step that follows a state."""

    def __init__(self, vehicle: Vehicle, stop: ChargingStop, step_s: float, heating: HeatingLimit) -> None:
        vehicle = vehicle_at_charger(vehicle)
        self._vehicle, self._stop = vehicle, stop
        charging, battery = charging_of(vehicle), vehicle.battery
        self._set_point_c = None if charging.cooling is None else charging.cooling.set_point_c
        self._limit_w = charging.power_limit.function(FLOATS)
        self._voltage_v = battery.open_circuit_voltage.function(FLOATS)
        self._supply_w, self._heater_w = supply_of(vehicle, stop), heater_power_of(vehicle, stop)
        self._limits = heating.function(charging.heated_below_c)
        self._leakage_w_per_k = battery.leakage.coefficient_w_per_k(0.0)
        self._idle_heat_w = idle_heat_w(self._leakage_w_per_k, stop.ambient_c, 0.0)
        self._cooling = make_cooling(charging.cooling, stop.ambient_c, FLOATS)
        self._rates = make_charging_rates(self._limit_w, self._cooling, make_rates(vehicle, FLOATS), FLOATS)
        self._integrate = make_charging_step(self._rates)
        self._heat_step = make_heat_step(vehicle, FLOATS)
        self._hottest_c = hottest_c(vehicle)
        self._step_s = step_s
        fastest_w_per_k = self._leakage_w_per_k + (
            0.0 if charging.cooling is None else
            charging.cooling.cooling_power_w / charging.cooling.proportional_band_k)
        self._most_step_s = math.inf if fastest_w_per_k == 0.0 else (
            TIME_CONSTANT_SHARE * battery.heat_capacity_j_per_k / fastest_w_per_k)

    def _power_w(self, soc: float, temperature_c: float, left_w: float) -> float:
        """Return P_c [W] at a state, with `left_w` [W] left by all others."""
        power_w: float = charging_power(self._limit_w(soc, temperature_c), left_w, FLOATS)
        return power_w

    def _command_w(self, soc: float, temperature_c: float) -> float:
        return self._heater_w if temperature_c < self._limits(soc) else 0.0

    def problem_at(self, state: BatteryState) -> str | None:
        """Return why the battery can never be charged further from a state, or None."""
        soc, temperature_c, stop = state.soc, state.temperature_c, self._stop
        if self._supply_w <= CHARGES_FROM_W:
            given_w = self._supply_w + stop.cabin_heating_power_w + stop.auxiliary_power_w
            return (f'cabin and auxiliaries take all of the {given_w / 1000.0:.1f} kW that charger and '
                    'inlet provide')

        def may_charge(at_c: float) -> bool:
            left_w = self._supply_w - self._command_w(soc, at_c)
            return self._power_w(soc, at_c, left_w - self._cooling(at_c, left_w)[0]) > CHARGES_FROM_W

        if may_charge(temperature_c):
            return None
        settled_c = self._settled_c(soc, temperature_c)
        if self._set_point_c is not None:
            settled_c = min(settled_c, self._cooled_down_c(soc, temperature_c, self._set_point_c))
        # Heat under way comes on top.
        late_k = max(0.0, state.coolant_excess_k) + (
            self._vehicle.heat_path.heater_lag_s * self._vehicle.hvch.efficiency * state.heater_power_w
            / self._vehicle.battery.heat_capacity_j_per_k)
        if late_k > 0.0:
            settled_c = max(settled_c, temperature_c) + late_k
        if any(map(may_charge, np.linspace(temperature_c, settled_c, OUTLOOK_POINTS).tolist())):
            return None
        at = f'at {100.0 * soc:.1f} % and {temperature_c:.1f} degC'
        if -self._limit_w(soc, settled_c) > CHARGES_FROM_W:
            taker, change = ('cooling', 'colder') if settled_c < temperature_c else ('heater', 'warmer')
            return (f'{at} the {taker} takes all the power that is left, and the battery gets no {change} than '
                    f'{settled_c:.1f} degC')
        change = 'warmer' if settled_c > temperature_c else 'colder' if self._is_hot(soc, temperature_c) else ''
        end = f', and the battery gets no {change} than {settled_c:.1f} degC' if change else ''
        return f'{at} the battery takes less than {CHARGES_FROM_W:g} W{end}'

    def _is_hot(self, soc: float, temperature_c: float) -> bool:
        """Return whether the battery would take more power if it were colder."""
        coldest_c = self._vehicle.battery.temperature_range_c[0]
        return any(-self._limit_w(soc, at_c) > CHARGES_FROM_W for at_c in np.linspace(
            coldest_c, temperature_c, OUTLOOK_POINTS).tolist())

    def _cooled_down_c(self, soc: float, temperature_c: float, set_point_c: float) -> float:
        """Return the temperature down to which leakage and cooling bring a battery that is not charged [deg C]."""
        coldest_c = min(self._stop.ambient_c, temperature_c)
        if self._leakage_w_per_k == 0.0:
            return min(temperature_c, max(coldest_c, set_point_c))

        def is_warmer(at_c: float) -> bool:
            left_w = self._supply_w - self._command_w(soc, at_c)
            return bool(self._idle_heat_w - self._leakage_w_per_k * at_c - self._cooling(at_c, left_w)[1] < 0.0)

        if not is_warmer(temperature_c):
            return temperature_c
        # The heat balance falls strictly with the temperature; the radiator's air is no lower bound of a chiller.
        lowest_c = min(coldest_c, self._vehicle.battery.temperature_range_c[0])
        return halve(temperature_c, lowest_c, is_warmer, SETTLING_HALVINGS)

    def _settled_c(self, soc: float, temperature_c: float) -> float:
        """Return the temperature at which a battery that is not charged settles [deg C]."""
        command_w = self._command_w(soc, temperature_c)
        heat_w = self._vehicle.hvch.efficiency * command_w
        if self._leakage_w_per_k == 0.0:
            settled_c = self._hottest_c if heat_w > 0.0 else temperature_c
        else:
            settled_c = self._stop.ambient_c + heat_w / self._leakage_w_per_k
        # Heating ends at its limit; from there the battery settles without it.
        return max(temperature_c, min(settled_c, self._limits(soc))) if command_w else settled_c

    def _above_k(self, state: BatteryState) -> float:
        """Return by how much battery and heat under way exceed the limit of heating [K]."""
        reached_c: float = heated_c(
            self._vehicle, state.temperature_c, state.heater_power_w, state.coolant_excess_k)
        return reached_c - self._limits(state.soc)

    def step_from(self, state: BatteryState) -> _Step:
        """Return the step from a state; it ends when heating or the session is to end."""
        above_k = self._above_k(state)
        command_w = self._heater_w if above_k < 0.0 else 0.0
        is_held = abs(above_k) <= TEMPERATURE_TOLERANCE_K
        length_s = self._length_s(state, HELD_STEPS if is_held else 1.0)
        if is_held:
            command_w = self._holding_w(state, length_s)
        step = self._step(state, command_w, length_s)
        if not is_held:
            side = math.copysign(1.0, -above_k)
            if side * self._above_k(step.end) > 0.0:
                step = self._cut(state, command_w, step, lambda end: side * self._above_k(end),
                                 TEMPERATURE_TOLERANCE_K)
        if step.end.soc > self._stop.departure_soc:
            step = self._cut(state, command_w, step,
                             lambda end: end.soc - self._stop.departure_soc, STEP_SOC_TOLERANCE)
        return step

    def _holding_w(self, state: BatteryState, length_s: float) -> float:
        """Return the command [W] that holds the limit of heating for a step [s]; 0 or full power if none does."""
        def attempt(command_w: float) -> Trial[float]:
            return Trial(command_w, self._above_k(self._step(state, command_w, length_s).end), command_w)

        warming_k_per_w = length_s * self._vehicle.hvch.efficiency / heated_heat_capacity_j_per_k(self._vehicle)
        # The power of the step before is nearly right.
        first = attempt(min(state.heater_power_w, self._heater_w))
        if first.excess > TEMPERATURE_TOLERANCE_K and attempt(0.0).excess >= 0.0:
            return 0.0
        return follow_slope(self._heater_w, 0.0, first, warming_k_per_w, attempt,
                            TEMPERATURE_TOLERANCE_K).outcome

    def _length_s(self, state: BatteryState, longer: float) -> float:
        """Return the longest allowed step from a state [s], regardless of the heater."""
        step_s = min(longer * self._step_s, self._most_step_s)
        power_w = self._power_w(state.soc, state.temperature_c, self._supply_w)
        if power_w == 0.0:
            return step_s
        full_s = (self._vehicle.battery.capacity_as
                  * self._voltage_v(state.soc, state.temperature_c) / power_w)
        return min(step_s, STEP_SOC * full_s)

    def _step(self, state: BatteryState, command_w: float, duration_s: float) -> _Step:
        soc, temperature_c = state.soc, state.temperature_c
        other_heat_w = 0.0
        if self._vehicle.heat_path.has_coolant:
            other_heat_w = self._vehicle.battery.heat_capacity_j_per_k * self._rates(
                soc, temperature_c, command_w - self._supply_w, 0.0, self._idle_heat_w,
                self._leakage_w_per_k)[1]
        drawn_w, arriving_w, heater_w, coolant_c = self._heat_step(
            state.heater_power_w, temperature_c + state.coolant_excess_k, temperature_c, duration_s, command_w,
            other_heat_w, self._idle_heat_w, self._leakage_w_per_k)
        soc, end_c, mean_c, powers = self._integrate(
            soc, temperature_c, duration_s, drawn_w - self._supply_w, 0.0,
            self._idle_heat_w + arriving_w, self._leakage_w_per_k)
        leakage_w = self._idle_heat_w - self._leakage_w_per_k * mean_c
        if end_c > self._hottest_c:
            # The car's own cooling, which the model does not describe.
            leakage_w -= ((end_c - self._hottest_c) * self._vehicle.battery.heat_capacity_j_per_k
                          / duration_s)
            end_c = self._hottest_c
        excess_k = coolant_c - end_c if self._vehicle.heat_path.has_coolant else state.coolant_excess_k
        return _Step(duration_s, BatteryState(end_c, soc, heater_w, excess_k), powers.terminal_w, drawn_w,
                     arriving_w, leakage_w, powers.cooling_w, powers.cooled_w)

    def _cut(self, state: BatteryState, command_w: float, whole: _Step,
             excess_of: Callable[[BatteryState], float], tolerance: float) -> _Step:
        """Return the part of a step after which `excess_of` its end is just above 0."""
        def attempt(duration_s: float) -> Trial[_Step]:
            step = self._step(state, command_w, duration_s)
            return Trial(duration_s, excess_of(step.end), step)

        return close_in(
            Trial(whole.duration_s, excess_of(whole.end), whole), Trial(0.0, excess_of(state), whole),
            attempt, tolerance, MOST_STEP_TRIALS).outcome


def _session(vehicle: Vehicle, stop: ChargingStop, problem: str | None, states: list[BatteryState],
             steps: list[_Step]) -> Session:
    """Return the Session from its simulated steps; its energies close the heat balance to rounding."""
    hours = np.array([step.duration_s for step in steps]) / JOULES_PER_WH
    terminal_w, drawn_w, arriving_w, leakage_w, cooling_w, cooled_w = (
        np.array([getattr(step, name) for step in steps])
        for name in ('terminal_w', 'drawn_w', 'arriving_w', 'leakage_w', 'cooling_w', 'cooled_w'))
    terminal, drawn, arriving, leakage, cooling, cooled = (
        float(hours @ power_w) for power_w in (terminal_w, drawn_w, arriving_w, leakage_w, cooling_w, cooled_w))
    side, temperature_c = float(hours.sum()), np.array([state.temperature_c for state in states])
    joule = (vehicle.battery.heat_capacity_j_per_k * float(temperature_c[-1] - temperature_c[0])
             / JOULES_PER_WH - arriving - leakage + cooled)
    cabin, auxiliary = side * stop.cabin_heating_power_w, side * stop.auxiliary_power_w
    hvch_heat = vehicle.hvch.efficiency * drawn if vehicle.heat_path.is_shell else arriving
    time_s = np.concatenate(([0.0], np.cumsum(hours) * JOULES_PER_WH))
    soc, ageing = np.array([state.soc for state in states]), charging_of(vehicle).ageing
    return Session(
        problem=problem,
        time_s=time_s,
        battery_temperature_c=temperature_c,
        soc=soc,
        charging_power_w=terminal_w,
        hvch_battery_power_w=drawn_w,
        cooling_power_w=cooling_w,
        energy_wh=SessionEnergies(
            bought=terminal + drawn + cooling + cabin + auxiliary, terminal=terminal, stored=terminal - joule,
            joule=joule, hvch_electric=drawn, hvch_heat=hvch_heat, cabin=cabin, auxiliary=auxiliary,
            leakage=leakage, cooling_electric=cooling, cooling_heat=cooled),
        ageing=None if ageing is None else session_ageing(ageing, time_s, temperature_c, soc))
