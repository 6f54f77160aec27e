# SPDX-License-Identifier: Apache-2.0
"""What a planning method decides: when to heat. Everything else of a Plan follows from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.heat_run import HeatRun
    from bev_preheat.planning.trip import Inputs, Trip
    from bev_preheat.vehicle.model import Integrator

# A heater power below this share of what the cabin leaves is rounding.
HEATING_SHARE = 1e-4


class HeldBack(Enum):
    """Why a plan heats less than its target asks for."""

    RESERVE = 'the state of charge that must be left'
    POWER = 'the power that an emptier battery would lack'


@dataclass(frozen=True)
class Schedule:
    """
    Heater power [W] in each of the N steps, and the forward run that goes with it.

    `heating_start_s` is the switching instant, None where nothing is heated; `brake_power_w` is
    what the friction brake takes of the regeneration in each step; `soc` and `temperature_c`
    (N + 1 values) are the run, made with `make_integrator` of `model`. `heating_end_s` is where
    heating ends for good within a step; None: at the end of a step.

    `empty_at_s` is the instant at which the charge runs out, None where it does not; from then on
    the vehicle stands, and `driven_share` (N,) is the share of each step that it drives (None: all).
    `held_back` (HeldBack) is why a warmer battery was ruled out; None: it was
    not. Where the vehicle has a heat path, `heater_power_w` is what is commanded, and `heat` (a
    HeatRun) what becomes of it; None: the heater takes what is commanded.

    `kept` is what has been worked out of the run, for who asks again (`dynamics.limits_along`).
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
    kept: dict[str, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def drawn_power_w(self) -> FloatArray:
        """Return what the heater takes in each step, on average [W], shape (N,)."""
        return self.heater_power_w if self.heat is None else self.heat.drawn_power_w

    def inputs(self, trip: Trip) -> Inputs:
        """Return the inputs of the model's steps along this run of a Trip; see Trip.inputs."""
        if self.heat is None:
            return trip.inputs(self.heater_power_w, self.brake_power_w)
        duration_s, power_w, variance_w2, heat_w, leakage_w_per_k = trip.inputs(
            None, self.brake_power_w)
        return (duration_s, power_w + self.heat.drawn_power_w, variance_w2,
                heat_w + self.heat.arriving_heat_w, leakage_w_per_k)


# A method's `plan_NAME(trip, state, goal, unheated=None)`, with options of its own.
Method = Callable[..., Schedule]


def maximum_from(trip: Trip, switching_instant_s: float) -> FloatArray:
    """
    Heater power [W] of each step, shape (N,): zero, one partial step, then what the cabin leaves.

    The step in which the heater is switched on carries its mean over the step.
    """
    duration_s = trip.route.duration_s
    share_on = np.minimum(np.maximum(
        (trip.time_s[1:] - switching_instant_s) / duration_s, 0.0), 1.0)
    return share_on * trip.heater_limit_w


def switched_on_s(trip: Trip, heater_power_w: FloatArray) -> float | None:
    """
    Return the first instant of heating [s] under heater powers [W] (N,); None if there is none.

    A first step that is heated in part is off first, then at full power to its end.
    """
    limit_w = trip.heater_limit_w
    heated = np.flatnonzero(heater_power_w > HEATING_SHARE * limit_w)
    if not len(heated):
        return None
    first = heated[0]
    share_on = min(heater_power_w[first] / limit_w[first], 1.0)
    return float(trip.time_s[first + 1] - share_on * trip.route.duration_s[first])
