# SPDX-License-Identifier: Apache-2.0
"""The simulated car's heat sources: power and heat, the lease on them, faults, controllers with the gates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import math
from typing import TYPE_CHECKING

from bev_preheat.numerics import FLOATS, JOULES_PER_WH, NS_PER_S
from bev_preheat.tunables import ROUNDING_W
from bev_preheat.vehicle.description import HVCH, Vehicle
from bev_preheat.vehicle.heater_controller import HeaterController, HeaterLimits, Instant, step_below_w

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


# Of a sum of steps [s].
ROUNDING_S = 1e-3


class SimulatedSources:
    """
    Commands and powers of the heat sources of a car beside its HVCH, by name [W].

    A faulty source delivers a share of its command, in `shares` (0 ... 1; inf: all its power, whatever the
    command). `drawn_w` and `heat_w` are the present sums: electrical power, and the HVCH power with their heat.
    `energy_wh` is the energy of each so far, `heat_j` the HVCH energy with their heat.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._sources = {source.name: (source, source.maximum_power_w.function(FLOATS),
                                       source.hvch_watts.function(FLOATS)) for source in vehicle.heat_sources}
        self.shares: dict[str, float] = {}
        self.commands_w: Mapping[str, float] = {}
        self.energy_wh = dict.fromkeys(self._sources, 0.0)
        self.heat_j = 0.0
        self._off_s = dict.fromkeys(self._sources, math.inf)
        self.off()

    def __bool__(self) -> bool:
        """Return whether the car has such sources."""
        return bool(self._sources)

    def off(self) -> None:
        """Draw nothing."""
        self.powers_w = dict.fromkeys(self._sources, 0.0)
        self.drawn_w = self.heat_w = 0.0

    def go_on_from(self, before: SimulatedSources) -> None:
        """Take over for how long each source has been off."""
        self._off_s.update(before._off_s)

    def count(self, step_s: float) -> None:
        """Add the present powers over a time [s] to the energies."""
        self.heat_j += step_s * self.heat_w
        for name, power_w in self.powers_w.items():
            self.energy_wh[name] += step_s * power_w / JOULES_PER_WH
            self._off_s[name] = 0.0 if power_w > 0.0 else self._off_s[name] + step_s

    def heat(self, ambient_c: float, temperature_c: float, speed_mps: float, cabin_w: float,
             room_w: float, is_hot: bool) -> None:
        """
        Draw the commands as far as air, battery, speed, cabin heating and `room_w`, left by the battery, allow.

        Temperatures in degC, powers in W; the sources share the rest in the order of the file. Those that heat get
        nothing if the battery `is_hot`. A source with steps runs at the next lower one, and does not start again
        before its minimum time off.
        """
        self.off()
        for name, (source, most_w, hvch_watts) in self._sources.items():
            limit_w = float(most_w(ambient_c, temperature_c)) - (cabin_w if source.shares_cabin_limit else 0.0)
            limit_w = min(limit_w, room_w - self.drawn_w)
            share, command_w = self.shares.get(name, 1.0), self.commands_w.get(name, 0.0)
            if source.power_steps_w:
                command_w = step_below_w(source.power_steps_w, min(command_w, limit_w) + ROUNDING_W)
            wanted_w = math.inf if share == math.inf else share * command_w
            rests = 0.0 < self._off_s[name] < source.minimum_off_time_s - ROUNDING_S
            power_w = max(0.0, min(wanted_w, limit_w)) if (
                source.serves_at(speed_mps) and not rests and (source.cools or not is_hot)) else 0.0
            self.powers_w[name] = power_w
            self.drawn_w += power_w
            self.heat_w += power_w * float(hvch_watts(ambient_c, temperature_c))


# A test may command once for a long drive; another node's clock may be some ticks ahead [s].
SIMULATED_LEASE_S, CLOCK_TOLERANCE_S = 7200.0, 10.0


class HeaterSide:
    """
    The controllers of the heat sources of an ImperfectCar, by name.

    Stamps follow the car's clock, which may jump, and the steady clock is the car's time. `start_ns` is the
    instant of the start of the drive by the clock of the stamps [ns].
    """

    def __init__(self, car: ImperfectCar) -> None:
        self._car = car
        self.restart()

    def restart(self) -> None:
        """Forget all commands and who sent them, as after a restart: time that stands ends no lease."""
        vehicle = self._car.vehicle
        self._controllers = {name: HeaterController(HeaterLimits(
            vehicle.most_w(name), longest_lease_s=SIMULATED_LEASE_S, clock_tolerance_s=CLOCK_TOLERANCE_S,
            steps_w=vehicle.steps_w(name))) for name in (HVCH, *(source.name for source in vehicle.heat_sources))}

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
