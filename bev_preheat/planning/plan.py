# SPDX-License-Identifier: Apache-2.0
"""
The result of planning, of the same type for every method and for the NLP; the accounts of two plans.

A plan that arrives colder, eats into the reserve or has a power deficit spends less because it does less. Heat
beyond the target counts as waste.
"""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
import math
from typing import Any, Protocol

import numpy as np

from bev_preheat.numerics import FloatArray, JOULES_PER_WH, WH_PER_KWH
from bev_preheat.planning.dynamics import Accounts, Energies
from bev_preheat.planning.engine import keep_accounts
from bev_preheat.planning.schedule import HeatingInterval, HeatRun, HeldBack, Schedule, StepPrices, Stranding
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import Trip
from bev_preheat.tunables import NO_WORSE_W, SAME_SOC, SHORTFALL_TOLERANCE_K
from bev_preheat.vehicle.model import make_runge_kutta_4


@dataclass(frozen=True)
class Plan:
    """
    A heating plan and its predicted outcome; times in seconds after the start of the plan.

    `heating_start_s` is None if the plan does not heat; `heating_end_s` is None if heating ends with a step, as on
    arrival. `shortfall_k` is by how much the target is missed, `soc_shortfall` by how much the reserve is missed,
    `undeliverable_power_w` the power deficit of the battery in the worst step (at `undeliverable_at_s`).
    `sentence` turns the plan into its `explanation` on demand: most plans are followed, not read. `intervals`
    (planning.schedule.HeatingInterval) give the reasons for heating, `held_back`
    (planning.schedule.HeldBack) the reason for not heating more, and `stranding` (planning.schedule.Stranding)
    where the charge runs out, or None. Shapes: `time_s`, `battery_temperature_c` and `soc` (N + 1,);
    `hvch_battery_power_w` (N,), the mean electrical power in each step; `friction_brake_power_w` (N,), the power
    that the friction brake takes because the battery cannot. If the vehicle has a heat path,
    `hvch_battery_power_w` is the command and `heat` (planning.schedule.HeatRun) its outcome; else None.
    `note` is a remark on an installed method's powers, '' without one. `unheated_because` is why a plan without
    heat misses its target. `source_power_w` has the electrical power (N,) [W] of each heat source, the HVCH
    included; it is empty for a vehicle with the HVCH alone. Such a vehicle has no `cooling_start_s` [s];
    `maximum_arrival_temperature_c` [deg C] may also be missed by `shortfall_k`.
    """

    status: Status
    sentence: Callable[..., str]
    method: str
    target_temperature_c: float
    heating_start_s: float | None
    time_s: FloatArray
    battery_temperature_c: FloatArray
    soc: FloatArray
    hvch_battery_power_w: FloatArray
    friction_brake_power_w: FloatArray
    energy_wh: Energies
    shortfall_k: float
    soc_shortfall: float
    undeliverable_power_w: float
    undeliverable_at_s: float | None
    intervals: tuple[HeatingInterval, ...]
    planning_time_s: float
    heating_end_s: float | None = None
    held_back: HeldBack | None = None
    stranding: Stranding | None = None
    heat: HeatRun | None = None
    note: str = ''
    unheated_because: str = ''
    source_power_w: Mapping[str, FloatArray] = field(default_factory=dict)
    maximum_arrival_temperature_c: float = math.inf
    cooling_start_s: float | None = None

    @cached_property
    def explanation(self) -> str:
        """The outcome of the plan, as a sentence."""
        return self.sentence(self)

    @property
    def drawn_power_w(self) -> FloatArray:
        """The mean power of the heater, or of all heat sources, in each step [W], shape (N,)."""
        return self.hvch_battery_power_w if self.heat is None else self.heat.drawn_power_w

    @property
    def command_w(self) -> FloatArray:
        """The heat of all heat sources as HVCH power [W], shape (N,): the control of `Schedule`."""
        return (self.heat.heater_power_w[1:] if self.source_power_w and self.heat is not None else
                self.hvch_battery_power_w)

    @property
    def start_state(self) -> BatteryState:
        """The state at the start of the plan, with the heat under way."""
        return self._state_at(0)

    @property
    def arrival_state(self) -> BatteryState:
        """The state on arrival, with the heat under way; the heater is off from then on, as a session requires."""
        return self._state_at(-1)

    def _state_at(self, at: int) -> BatteryState:
        heater = 0.0 if self.source_power_w else 1.0
        under_way = () if self.heat is None else (
            heater * float(self.heat.heater_power_w[at]), float(self.heat.coolant_excess_k[at]))
        return BatteryState(float(self.battery_temperature_c[at]), float(self.soc[at]), *under_way)

    @property
    def arrival_time_s(self) -> float:
        """Instant of arrival [s]."""
        return self.time_s.item(-1)

    @property
    def arrival_temperature_c(self) -> float:
        """Battery temperature on arrival [deg C]."""
        return self.battery_temperature_c.item(-1)

    @property
    def arrival_soc(self) -> float:
        """State of charge on arrival, 0 ... 1."""
        return self.soc.item(-1)

    def told(self, status: Status, sentence: Callable[..., str]) -> Plan:
        """Return the plan with another status and sentence; `words` of `explain` is passed on to the latter."""
        return replace(self, status=status, sentence=sentence)

    def power_at_w(self, elapsed_s: float) -> float:
        """
        Return the heat as HVCH power, `command_w`, [W] at an instant [s] of the plan, 0 before it starts.

        In a step with a switching instant it is off before the first instant and after the last one, and at
        full power between them; of several heat sources, full power would be that of the dearest, too.
        """
        step = int(self.time_s.searchsorted(elapsed_s, side='right')) - 1
        if self.source_power_w:
            return self.command_w.item(step) if 0 <= step < len(self.command_w) else 0.0
        last_s = self.arrival_time_s if self.heating_end_s is None else self.heating_end_s
        if self.heating_start_s is None or not self.heating_start_s <= elapsed_s < last_s:
            return 0.0
        start_s, end_s = self.time_s.item(step), self.time_s.item(step + 1)
        heated_s = min(end_s, last_s) - max(start_s, self.heating_start_s)
        return self.command_w.item(step) * (end_s - start_s) / heated_s

    def as_dictionary(self) -> dict[str, Any]:
        """Return the plan as `preheat plan --json` writes it: plain numbers, texts and lists."""
        return {
            'status': self.status.name,
            'explanation': self.explanation,
            **{name: getattr(self, name) for name in (
                'method', 'target_temperature_c', 'heating_start_s', 'heating_end_s', 'arrival_time_s',
                'arrival_temperature_c', 'arrival_soc', 'shortfall_k', 'soc_shortfall', 'undeliverable_power_w',
                'undeliverable_at_s')},
            'charge_runs_out_at_s': self.stranding and self.stranding.at_s,
            'charge_runs_out_at_m': self.stranding and self.stranding.at_m,
            'lacking_energy_wh': self.stranding.deficit_wh if self.stranding else 0.0,
            'stretches': [{'start_s': interval.start_s, 'end_s': interval.end_s,
                           'energy_wh': interval.energy_wh, 'reason': interval.reason.name}
                          for interval in self.intervals],
            'energy_wh': asdict(self.energy_wh),
            'planning_time_s': self.planning_time_s,
            **{name: getattr(self, name).tolist() for name in (
                'time_s', 'battery_temperature_c', 'soc', 'hvch_battery_power_w', 'friction_brake_power_w')},
            **({} if self.heat is None else {'heat': self.heat.as_dictionary()}),
            **({'heat_source_power_w': {name: power_w.tolist() for name, power_w in self.source_power_w.items()}}
               if self.source_power_w else {}),
            **({'cooling_start_s': self.cooling_start_s} if self.cooling_start_s is not None else {}),
            **({'maximum_arrival_temperature_c': self.maximum_arrival_temperature_c}
               if math.isfinite(self.maximum_arrival_temperature_c) else {}),
        }


@dataclass(frozen=True)
class StepDeficit:
    """A constraint that cannot be kept, and by how much; `text` describes it."""

    constraint: str
    amount: float
    unit: str
    text: str


@dataclass(frozen=True)
class Optimum:
    """
    The optimum, or the best possible result.

    `solver_status` is IPOPT's status for the program itself; only 'Solve_Succeeded' is an optimum.
    `deficit` holds the constraints that cannot be kept; it is empty if and only if `plan` is the optimum.
    `solve_time_s` is IPOPT's time, from all starts, without the setup of programs.
    `marginal_cost_wh_per_k` is the multiplier of the target: the cost of one more kelvin on arrival
    (NaN if the target does not bind or cannot be met).
    """

    plan: Plan
    solver_status: str
    iterations: int
    solve_time_s: float
    deficit: tuple[StepDeficit, ...]
    marginal_cost_wh_per_k: float

    @property
    def infeasible(self) -> tuple[str, ...]:
        """Sentences on the constraints that cannot be kept, with figures."""
        return tuple(item.text for item in self.deficit)

    def as_dictionary(self) -> dict[str, Any]:
        """Return the optimum as `preheat optimum --json` writes it."""
        return {**self.plan.as_dictionary(), 'solver_status': self.solver_status,
                'solve_time_s': self.solve_time_s, 'iterations': self.iterations,
                'infeasible': list(self.infeasible),
                'marginal_cost_wh_per_k': self.marginal_cost_wh_per_k}


class Reached(Protocol):
    """The results of a plan: a Plan, or figures read from one."""

    @property
    def arrival_temperature_c(self) -> float:
        """Battery temperature on arrival [deg C]."""

    @property
    def shortfall_k(self) -> float:
        """By how much the target is missed [K]."""

    @property
    def soc_shortfall(self) -> float:
        """By how much the reserve is missed, 0 ... 1."""

    @property
    def undeliverable_power_w(self) -> float:
        """Worst power deficit of the battery [W]."""


def difference(plan: Reached, optimum: Reached) -> str:
    """Return as text how a plan's result differs from the optimum's, '' if both reach the same; NaN is unknown."""
    missed_k = plan.shortfall_k - optimum.shortfall_k
    # Too cold for the target, or too warm for the highest temperature on arrival.
    is_colder = plan.arrival_temperature_c < optimum.arrival_temperature_c
    deficit_w = plan.undeliverable_power_w - optimum.undeliverable_power_w
    if not abs(missed_k) <= SHORTFALL_TOLERANCE_K:
        return (f'{abs(missed_k):.2f} K {"colder" if is_colder else "warmer"}'
                if missed_k == missed_k else 'unknown arrival')
    if (plan.soc_shortfall > SAME_SOC) != (optimum.soc_shortfall > SAME_SOC):
        return ('reserve missed' if plan.soc_shortfall > SAME_SOC else
                'reserve kept')
    if not abs(deficit_w) <= NO_WORSE_W:
        return (f'power deficit {abs(deficit_w) / 1e3:.2f} kW {"larger" if deficit_w > 0.0 else "smaller"}'
                if deficit_w == deficit_w else 'unknown power')
    return ''


def energy_gap_wh(plan: Plan, optimum: Plan) -> float | None:
    """Return the battery energy of a Plan above the optimum's [Wh]; None if their results differ."""
    if difference(plan, optimum):
        return None
    return plan.energy_wh.battery_total - optimum.energy_wh.battery_total


def cost_of(plan: Plan, step_prices: StepPrices) -> float:
    """Return the cost of the heater's energy in a Plan, in the currency of the prices."""
    energy_wh = plan.drawn_power_w * np.diff(plan.time_s) / JOULES_PER_WH
    return float(energy_wh @ step_prices(plan.time_s)) / WH_PER_KWH


def accounts_of(trip: Trip, plan: Plan) -> Accounts:
    """Return the Accounts of a plan for this trip: energies [Wh], and powers in each of the N steps [W]."""
    return keep_accounts(trip, Schedule(
        plan.heating_start_s, plan.command_w, plan.friction_brake_power_w,
        plan.soc, plan.battery_temperature_c, make_runge_kutta_4,
        driven_share=driven_share(trip, plan), heat=plan.heat))


def driven_share(trip: Trip, plan: Plan) -> FloatArray:
    """Return the driven share of each step, shape (N,): 0 once the battery is empty."""
    empty_s = np.inf if plan.stranding is None else plan.stranding.at_s
    return np.clip((empty_s - trip.time_s[:-1]) / trip.route.duration_s, 0.0, 1.0)
