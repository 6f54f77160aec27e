# SPDX-License-Identifier: Apache-2.0
"""The heat sources of a simulated car beside its HVCH: power and heat under the commands."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from bev_preheat.numerics import FLOATS, JOULES_PER_WH
from bev_preheat.tunables import ROUNDING_W
from bev_preheat.vehicle.heater_controller import step_below_w

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bev_preheat.vehicle.description import Vehicle


# Of a sum of steps [s].
ROUNDING_S = 1e-3


class SimulatedSources:
    """
    Commands and powers of the sources by name [W].

    A faulty source delivers a share of its command, in `shares` (0 ... 1; inf: all its power, whatever the
    command). `drawn_w` and `heat_w` are the present
    sums: electrical power, and the HVCH power with their heat. `energy_wh` is the energy of each so far, `heat_j`
    the HVCH energy with their heat.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        """Begin with all sources off."""
        self._sources = {source.name: (source, source.maximum_power_w.function(FLOATS),
                                       source.hvch_watts.function(FLOATS)) for source in vehicle.heat_sources}
        self.shares: dict[str, float] = {}
        self.commands_w: Mapping[str, float] = {}
        self.energy_wh = dict.fromkeys(self._sources, 0.0)
        self.heat_j = 0.0
        self._off_s = dict.fromkeys(self._sources, inf)
        self.off()

    def __bool__(self) -> bool:
        """Return whether the car has such sources."""
        return bool(self._sources)

    def off(self) -> None:
        """Draw nothing."""
        self.powers_w = dict.fromkeys(self._sources, 0.0)
        self.drawn_w = self.heat_w = 0.0

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
            wanted_w = inf if share == inf else share * command_w
            rests = 0.0 < self._off_s[name] < source.minimum_off_time_s - ROUNDING_S
            power_w = max(0.0, min(wanted_w, limit_w)) if (
                source.serves_at(speed_mps) and not rests and (source.cools or not is_hot)) else 0.0
            self.powers_w[name] = power_w
            self.drawn_w += power_w
            self.heat_w += power_w * float(hvch_watts(ambient_c, temperature_c))
