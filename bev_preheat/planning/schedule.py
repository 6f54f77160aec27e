# SPDX-License-Identifier: Apache-2.0
"""The decision of a planning method: when to heat, and its outcome. The rest of a Plan follows from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum, IntEnum
from typing import Any, NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.planning.situation import BatteryState
from bev_preheat.tunables import HEATING_SHARE

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray
    from bev_preheat.planning.dynamics import Energies
    from bev_preheat.planning.trip import Inputs, Trip
    from bev_preheat.vehicle.model import Integrator


class HeldBack(Enum):
    """Why a plan heats less than its target asks for."""

    RESERVE = 'the state of charge that must be left'
    POWER = 'the power that an emptier battery would lack'
    START = 'the price of switching the heater on'


class Reason(IntEnum):
    """The purpose of a heating interval; the numbers are those of PreheatPlan.stretch_reason."""

    ARRIVAL = 0
    SURPLUS = 1
    DESCENT = 2
    CLIMB = 3


@dataclass(frozen=True)
class HeatingInterval:
    """Heating from one instant to another [s], its energy [Wh, electrical], and its reason."""

    start_s: float
    end_s: float
    energy_wh: float
    reason: Reason


@dataclass(frozen=True)
class HeatRun:
    """
    A plan's heat on its way between heater and battery.

    At each instant (N + 1 values): the heater's power, `heater_power_w` [W, electrical], and the coolant's
    temperature above the battery's, `coolant_excess_k` [K]. In each step (N values) the means of the heater's
    power, `drawn_power_w`, and of the heat that reaches the battery, `arriving_heat_w` [W]. `lost_electric_wh` is
    the energy that a heater with lag draws after arrival.
    """

    heater_power_w: FloatArray
    coolant_excess_k: FloatArray
    drawn_power_w: FloatArray
    arriving_heat_w: FloatArray
    lost_electric_wh: float

    def as_dictionary(self) -> dict[str, Any]:
        """Return the run as JSON-compatible numbers and lists."""
        return {name: value if isinstance(value, float) else value.tolist() for name, value in vars(self).items()}


@dataclass(frozen=True)
class Schedule:
    """
    Heater power [W] in each of the N steps, and the forward run that goes with it.

    `heating_start_s` is the switching instant, None without heating; `brake_power_w` is the regeneration that the
    friction brake takes in each step; `soc` and `temperature_c` (N + 1 values) are the run, computed with
    `make_integrator` of `model`. `heating_end_s` is the instant at which heating ends for good within a step;
    None: at the end of a step.

    `empty_at_s` is the instant at which the charge runs out, or None. From then on the vehicle stands, and
    `driven_share` (N,) is the share of each step that it drives (None: all). `held_back` (HeldBack) is why a
    warmer battery was ruled out, or None. If the vehicle has a heat path, `heater_power_w` is the command and
    `heat` (a HeatRun) its outcome; with None the heater follows the command.
    """

    heating_start_s: float | None
    heater_power_w: FloatArray
    brake_power_w: FloatArray
    soc: FloatArray
    temperature_c: FloatArray
    make_integrator: Integrator
    heating_end_s: float | None = None
    empty_at_s: float | None = None
    driven_share: FloatArray | None = None
    held_back: HeldBack | None = None
    heat: HeatRun | None = None

    @property
    def drawn_power_w(self) -> FloatArray:
        """Return the mean power of the heater in each step [W], shape (N,)."""
        return self.heater_power_w if self.heat is None else self.heat.drawn_power_w

    @property
    def arrival_state(self) -> BatteryState:
        """The state on arrival, with the heat under way."""
        heat = self.heat
        under_way = () if heat is None else (heat.heater_power_w.item(-1), heat.coolant_excess_k.item(-1))
        return BatteryState(self.temperature_c.item(-1), self.soc.item(-1), *under_way)

    def inputs(self, trip: Trip) -> Inputs:
        """Return the inputs of the model's steps along this run of a Trip; see Trip.inputs."""
        if self.heat is None:
            return trip.inputs(self.heater_power_w, self.brake_power_w)
        duration_s, power_w, variance_w2, heat_w, leakage_w_per_k = trip.inputs(
            None, self.brake_power_w)
        return (duration_s, power_w + self.heat.drawn_power_w, variance_w2,
                heat_w + self.heat.arriving_heat_w, leakage_w_per_k)


class Stranding(NamedTuple):
    """
    The charge runs out `at_s` [s] and `at_m` [m] after the start of the trip.

    `deficit_wh` is the energy at the battery's terminals for the rest of the trip [Wh]; the losses of a battery
    that had this energy come on top.
    """

    at_s: float
    at_m: float
    deficit_wh: float


class ScheduleOutcome(NamedTuple):
    """The outcome of a Schedule; the fields are those of Plan, `heating_start_s` None if it does not heat."""

    energy_wh: Energies
    intervals: tuple[HeatingInterval, ...]
    heating_start_s: float | None
    undeliverable_power_w: float = 0.0
    undeliverable_at_s: float | None = None
    stranding: Stranding | None = None


# From instants [s] (N + 1,) of a plan to the mean price [per kWh] of each step (N,).
StepPrices = Callable[['FloatArray'], 'FloatArray']
# A method's `plan_NAME(trip, state, goal)`, with its own options.
Method = Callable[..., Schedule]


def maximum_from(trip: Trip, switching_instant_s: float) -> FloatArray:
    """Return the heater power [W] (N,): off, the mean of one partial step, then all that the cabin leaves."""
    duration_s = trip.route.duration_s
    share_on = np.minimum(np.maximum(
        (trip.time_s[1:] - switching_instant_s) / duration_s, 0.0), 1.0)
    return share_on * trip.heater_limit_w


def switched_on_s(trip: Trip, heater_power_w: FloatArray) -> float | None:
    """Return the first instant of heating [s] under powers [W] (N,), late in a partial step; None: no heating."""
    limit_w = trip.heater_limit_w
    heated = np.flatnonzero(heater_power_w > HEATING_SHARE * limit_w)
    if not len(heated):
        return None
    first = heated[0]
    share_on = min(heater_power_w[first] / limit_w[first], 1.0)
    return float(trip.time_s[first + 1] - share_on * trip.route.duration_s[first])


def ended_within(trip: Trip, schedule: Schedule, step: int) -> Schedule:
    """Return the Schedule whose heating ends for good in a partly heated step, which is on first, then off."""
    share_on = float(schedule.heater_power_w[step] / trip.heater_limit_w[step])
    if schedule.heating_start_s is None or share_on >= 1.0:
        return schedule
    start_s = float(trip.time_s[step])
    return replace(schedule, heating_start_s=min(schedule.heating_start_s, start_s),
                   heating_end_s=start_s + share_on * float(trip.route.duration_s[step]))
