# SPDX-License-Identifier: Apache-2.0
"""The simulated car's heater: the lease on its power, its faults, and its controller with the car's own gates."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import math
from typing import TYPE_CHECKING

from bev_preheat.numerics import NS_PER_S
from bev_preheat.vehicle.heater_controller import HeaterController, HeaterLimits, Instant

if TYPE_CHECKING:
    from bev_preheat.simulation.imperfect_car import ImperfectCar
    from bev_preheat.vehicle.heater_controller import HeaterAnswer, HeaterCommand, Verdict


@dataclass(frozen=True)
class HeaterLease:
    """
    Permission to use `power_w` [W] until `until_s` [s after the start of the route], then 0 W.

    `sources_w` has the powers of heat sources beside the HVCH, by name.
    """

    power_w: float
    until_s: float
    sources_w: Mapping[str, float] = field(default_factory=dict)


NO_LEASE = HeaterLease(0.0, -math.inf)


@dataclass(frozen=True)
class HeaterFault:
    """
    From one instant to another [s] the heater delivers `share` (0 ... 1) of the command.

    With `stuck_on` it uses all the power left by the cabin, whatever the command.
    """

    from_s: float
    until_s: float = math.inf
    share: float = 1.0
    stuck_on: bool = False


def fault_at(faults: Sequence[HeaterFault], instant_s: float) -> HeaterFault | None:
    """Return the last HeaterFault in the list that is active at an instant [s], or None."""
    return next((fault for fault in reversed(faults)
                 if fault.from_s <= instant_s < fault.until_s), None)


def next_change_s(faults: Sequence[HeaterFault], instant_s: float) -> float:
    """Return the next instant [s] after this one at which a fault begins or ends, or inf."""
    return min((edge_s for fault in faults for edge_s in (fault.from_s, fault.until_s)
                if edge_s > instant_s), default=math.inf)


# A test may command once for a long drive; another node's clock may be some ticks ahead [s].
SIMULATED_LEASE_S, CLOCK_TOLERANCE_S = 7200.0, 10.0


class HeaterSide:
    """
    The heater controller of an ImperfectCar.

    Stamps follow the car's clock, which may jump, and the steady clock is the car's time. `start_ns` is the
    instant of the start of the drive by the clock of the stamps [ns].
    """

    def __init__(self, car: ImperfectCar) -> None:
        """Take a car at its start."""
        self._car = car
        self.restart()

    def restart(self) -> None:
        """Forget all commands and who sent them, as after a restart: time that stands ends no lease."""
        vehicle = self._car.vehicle
        self._controller = HeaterController(HeaterLimits(
            vehicle.hvch.maximum_power_w, steps_w=vehicle.heating_gates.power_steps_w,
            longest_lease_s=SIMULATED_LEASE_S, clock_tolerance_s=CLOCK_TOLERANCE_S))

    def take(self, command: HeaterCommand, start_ns: int) -> Verdict:
        """Take a command that arrived and return its Verdict."""
        return self._controller.take(command, self._now(start_ns))

    def answer(self, start_ns: int) -> HeaterAnswer:
        """Return the HeaterAnswer of now."""
        plant = self._car.plant
        return self._controller.step(self._now(start_ns), obstacle=self._car.vehicle.heating_gates.verdict(
            plant.soc, plant.temperature_c, plant.speed_mps))

    def lease(self, start_ns: int) -> HeaterLease:
        """Return the HeaterLease under which the car drives on; instants after the start of the route."""
        answer = self.answer(start_ns)
        return HeaterLease(answer.active_w,
                           self._car.plant.time_s + self._controller.lease_left_s(self._now(start_ns)))

    @property
    def measured_w(self) -> float:
        """The heater's actual power [W]."""
        return self._car.plant.heater_power_w

    def _now(self, start_ns: int) -> Instant:
        return Instant(start_ns + round(self._car.clock_s * NS_PER_S), round(self._car.plant.time_s * NS_PER_S))
