# SPDX-License-Identifier: Apache-2.0
"""The phases of a simulated car's day: it drives, charges, and is parked."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from typing import TYPE_CHECKING

from bev_preheat.charging.equations import CoolingPowers, make_cooling
from bev_preheat.charging.stop import CERTAIN, Charger, ChargingProspect
from bev_preheat.numerics import FLOATS
from bev_preheat.route.segments import make_route, Route
from bev_preheat.vehicle.charging import vehicle_at_charger

if TYPE_CHECKING:
    from bev_preheat.planning.situation import Goal
    from bev_preheat.simulation.sensors import PositionReports
    from bev_preheat.simulation.traffic import Event
    from bev_preheat.vehicle.description import Vehicle

# Power of a parked car with its computers awake, and asleep [W].
AWAKE_POWER_W = 250.0
ASLEEP_POWER_W = 20.0
# A car that heats itself at the charger resumes this far below its limit [K].
HEATS_AGAIN_BELOW_K = 1.0


@dataclass(frozen=True)
class DrivePhase:
    """
    A drive over a Route, which the trip planner sends at its start, or `announced_s` [s] earlier.

    The trip planner reports that the car stood for `standing_time_s` [s] before; 0: unknown. The
    instants of `events` count from the start of the drive. `position` None: the car does not report its
    position. With `starts_over` the battery returns to its very first state, as in a recording played
    again. The trip planner reports the `charger` at the end (None: unknown) and the `prospect` of charging.
    """

    route: Route
    goal: Goal
    standing_time_s: float = 0.0
    events: tuple[Event, ...] = ()
    position: PositionReports | None = None
    announced_s: float = 0.0
    starts_over: bool = False
    charger: Charger | None = None
    prospect: ChargingProspect = CERTAIN

    @property
    def wanted_c(self) -> float:
        """The highest temperature on arrival if one is given, else the target [deg C]."""
        most_c = self.goal.maximum_arrival_temperature_c
        return most_c if math.isfinite(most_c) else self.goal.target_temperature_c


@dataclass(frozen=True)
class Charge:
    """
    Charging at `power_w` [W] until `until_soc` (0 ... 1) or for `duration_s` [s].

    The charger supplies battery, heater, cabin and auxiliaries; the battery's charge limit
    applies. With `heats_itself` the car heats its battery with all the power left by the cabin, without a
    command, up to the temperature in its file (`charging.heating_limit_c`). Its active cooling always works.
    """

    power_w: float
    duration_s: float
    ambient_temperature_c: float
    until_soc: float = 1.0
    cabin_heating_power_w: float = 0.0
    auxiliary_power_w: float = AWAKE_POWER_W
    heats_itself: bool = False

    def route(self) -> Route:
        """Return the phase as one segment of a Route, with the charger as regeneration without speed."""
        return _standing(self.duration_s, self.ambient_temperature_c, -self.power_w,
                         self.cabin_heating_power_w, self.auxiliary_power_w)

    def vehicle(self, vehicle: Vehicle) -> Vehicle:
        """Return the Vehicle at the charger: no drivetrain heat, its resistance and its power limit there."""
        vehicle = vehicle_at_charger(vehicle)
        battery = vehicle.battery
        if vehicle.charging is not None:
            battery = replace(battery, charge_power_limit=vehicle.charging.power_limit)
        return replace(vehicle, battery=battery, drivetrain=replace(
            vehicle.drivetrain, heat_recovery_efficiency=0.0))

    def cooling(self, vehicle: Vehicle) -> CoolingPowers:
        """Return the active cooling of the Vehicle at the charger (`charging.equations.make_cooling`)."""
        return make_cooling(None if vehicle.charging is None else vehicle.charging.cooling,
                            self.ambient_temperature_c, FLOATS)

    def own_heat_w(self, vehicle: Vehicle, temperature_c: float, is_heating: bool) -> float:
        """Return the power of the car's own battery heating [W] at a battery temperature [deg C]."""
        if not self.heats_itself or vehicle.charging is None:
            return 0.0
        below_c = vehicle.charging.heated_below_c - (0.0 if is_heating else HEATS_AGAIN_BELOW_K)
        return max(0.0, vehicle.hvch.maximum_power_w - self.cabin_heating_power_w
                   ) if temperature_c < below_c else 0.0


@dataclass(frozen=True)
class Park:
    """Parked for `duration_s` [s]: no drive, no cabin; battery states for `awake_s` [s], then asleep."""

    duration_s: float
    ambient_temperature_c: float
    awake_s: float = math.inf

    def route(self) -> Route:
        """Return the phase as one or two segments of a Route."""
        awake_s = min(self.awake_s, self.duration_s)
        parts = [_standing(duration_s, self.ambient_temperature_c, 0.0, 0.0, power_w)
                 for duration_s, power_w in ((awake_s, AWAKE_POWER_W),
                                             (self.duration_s - awake_s, ASLEEP_POWER_W))
                 if duration_s > 0.0]
        return parts[0] if len(parts) == 1 else parts[0].followed_by(parts[1])


Phase = DrivePhase | Charge | Park


def _standing(duration_s: float, ambient_c: float, propulsion_power_w: float, cabin_w: float,
              auxiliary_w: float) -> Route:
    return make_route({
        'duration_s': [duration_s], 'speed_mps': [0.0], 'propulsion_power_w': [propulsion_power_w],
        'ambient_temperature_c': [ambient_c], 'cabin_heating_power_w': [cabin_w],
        'auxiliary_power_w': [auxiliary_w]}, None)
