# SPDX-License-Identifier: Apache-2.0
"""The simulated car's heat sources: the lease on their power, their faults, their controllers with the gates."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
import math
from typing import TYPE_CHECKING

from bev_preheat.numerics import NS_PER_S
from bev_preheat.vehicle.description import HVCH
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
    From one instant to another [s] a heat source, the HVCH or another, delivers `share` (0 ... 1) of the command.

    With `stuck_on` it uses all the power left by the cabin, whatever the command.
    """

    from_s: float
    until_s: float = math.inf
    share: float = 1.0
    stuck_on: bool = False
    source: str = HVCH


def fault_at(faults: Sequence[HeaterFault], instant_s: float, source: str = HVCH) -> HeaterFault | None:
    """Return the last HeaterFault of a heat source in the list that is active at an instant [s], or None."""
    return next((fault for fault in reversed(faults)
                 if fault.source == source and fault.from_s <= instant_s < fault.until_s), None)


def next_change_s(faults: Sequence[HeaterFault], instant_s: float) -> float:
    """Return the next instant [s] after this one at which a fault begins or ends, or inf."""
    return min((edge_s for fault in faults for edge_s in (fault.from_s, fault.until_s)
                if edge_s > instant_s), default=math.inf)


# A test may command once for a long drive; another node's clock may be some ticks ahead [s].
SIMULATED_LEASE_S, CLOCK_TOLERANCE_S = 7200.0, 10.0


class HeaterSide:
    """
    The controllers of the heat sources of an ImperfectCar, by name.

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
        limits = HeaterLimits(
            0.0, longest_lease_s=SIMULATED_LEASE_S, clock_tolerance_s=CLOCK_TOLERANCE_S)
        self._controllers = {name: HeaterController(replace(
            limits, maximum_power_w=vehicle.most_w(name), steps_w=vehicle.steps_w(name)))
            for name in (HVCH, *(source.name for source in vehicle.heat_sources))}

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the sources, the HVCH first."""
        return tuple(self._controllers)

    def take(self, command: HeaterCommand, start_ns: int, name: str = HVCH) -> Verdict:
        """Take a command to a source that arrived and return its Verdict."""
        return self._controllers[name].take(command, self._now(start_ns))

    def answer(self, start_ns: int, name: str = HVCH) -> HeaterAnswer:
        """Return the HeaterAnswer of a source now."""
        plant = self._car.plant
        return self._controllers[name].step(self._now(start_ns), obstacle=self._car.vehicle.gates_of(name).verdict(
            plant.soc, plant.temperature_c, plant.speed_mps))

    def lease(self, start_ns: int) -> HeaterLease:
        """
        Return the HeaterLease under which the car drives on; instants after the start of the route.

        It ends with the first lease of a source that heats.
        """
        powers_w = {name: self.answer(start_ns, name).active_w for name in self._controllers}
        left_s = {name: controller.lease_left_s(self._now(start_ns))
                  for name, controller in self._controllers.items()}
        ends_s = min((left_s[name] for name, power_w in powers_w.items() if power_w > 0.0), default=left_s[HVCH])
        return HeaterLease(powers_w.pop(HVCH), self._car.plant.time_s + ends_s, powers_w)

    def measured_w(self, name: str = HVCH) -> float:
        """Return the actual power of a source [W]."""
        plant = self._car.plant
        return plant.heater_power_w if name == HVCH else plant.sources.powers_w[name]

    def _now(self, start_ns: int) -> Instant:
        return Instant(start_ns + round(self._car.clock_s * NS_PER_S), round(self._car.plant.time_s * NS_PER_S))
