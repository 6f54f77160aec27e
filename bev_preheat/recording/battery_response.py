# SPDX-License-Identifier: Apache-2.0
"""Response of the battery to another heater command than the recorded one, and to none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import copy
import math

from sensor_msgs.msg import BatteryState

from bev_preheat.numerics import FLOATS, NS_PER_S
from bev_preheat.vehicle.description import HVCH, Vehicle

# A longer time between two battery states is not bridged in one step [s].
LONGEST_REPLAYED_STEP_S = 10.0
# A charge or temperature that is unknown: the open-circuit voltage at these serves.
USUAL_SOC, USUAL_C = 0.5, 20.0
# A longer gap between two measurements starts the comparison without heating again [s].
UNHEATED_GAP_S = 600.0


class BatteryResponse:
    """
    Temperature, state of charge and power of a battery by how much they differ from the recorded ones.

    The difference of two solutions of eqs. (9b)-(9d) under the same drive: heat that comes in, leaks and is
    stored, C dT/dt = eta dP - gamma_0 T, and charge that it takes, ds/dt = -dP / (U_oc C_b); of other heat sources
    dP of the heat is the HVCH power with theirs. The change of the Joule heat with temperature (2 % per kelvin) is
    left out. `temperature_k` [K], `soc` (0 ... 1), `power_w` [W] of the battery's terminals.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        battery = vehicle.battery
        self._heat_capacity_j_per_k = vehicle.pack_heat_capacity_j_per_k
        self._leakage_w_per_k = battery.leakage.coefficient_w_per_k(0.0)
        self._efficiency = vehicle.hvch.efficiency
        self._voltage_v = battery.open_circuit_voltage.function(FLOATS)
        self._capacity_as = battery.capacity_as
        self.temperature_k = self.soc = self.power_w = self._heat_w = 0.0
        self._latest_ns: int | None = None

    def advance(self, now_ns: int, power_w: float, heat_w: float, soc: float, temperature_c: float) -> None:
        """
        Go on to an instant [ns] at a power that exceeds the recorded one by `power_w` [W].

        `heat_w` is the HVCH power with its heat [W]; `soc` and `temperature_c` are recorded, NaN: unknown.
        """
        before_ns, self._latest_ns = self._latest_ns, now_ns
        if before_ns is None or now_ns <= before_ns:
            self.power_w, self._heat_w = power_w, heat_w
            return
        left_s = (now_ns - before_ns) * 1e-9
        voltage_v = max(self._voltage_v(
            min(max(_finite(soc, USUAL_SOC), 0.0), 1.0), _finite(temperature_c, USUAL_C)), 1.0)
        while left_s > 0.0:
            step_s = min(left_s, LONGEST_REPLAYED_STEP_S)
            # Exact for a constant power.
            decay = math.exp(-self._leakage_w_per_k * step_s / self._heat_capacity_j_per_k)
            gain_k = (self._efficiency * self._heat_w * (1.0 - decay) / self._leakage_w_per_k
                      if self._leakage_w_per_k > 0.0
                      else self._efficiency * self._heat_w * step_s / self._heat_capacity_j_per_k)
            self.temperature_k = self.temperature_k * decay + gain_k
            self.soc -= self.power_w * step_s / (voltage_v * self._capacity_as)
            left_s -= step_s
        self.power_w, self._heat_w = power_w, heat_w

    def alter(self, message: BatteryState) -> None:
        """Add the difference to a battery state."""
        message.temperature += self.temperature_k
        message.percentage = min(max(message.percentage + self.soc, 0.0), 1.0)
        if len(message.cell_temperature):
            message.cell_temperature = [cell_c + self.temperature_k for cell_c in message.cell_temperature]
        if message.voltage > 0.0 and math.isfinite(message.voltage):
            message.current -= self.power_w / message.voltage


class SourceHeat:
    """The power and the heat of a vehicle's heat sources under commands."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._sources = {source.name: (source.maximum_power_w.function(FLOATS), source.hvch_watts.function(FLOATS))
                         for source in vehicle.heat_sources}

    def of(self, commands_w: Mapping[str, float], ambient_c: float, temperature_c: float) -> tuple[float, float]:
        """
        Return the electrical power [W] and the HVCH power with its heat [W] of commands by name [W].

        In air of `ambient_c` [deg C] (NaN: that of the battery), with a battery of `temperature_c` [deg C].
        """
        drawn_w = heat_w = commands_w.get(HVCH, 0.0)
        temperature_c = _finite(temperature_c, USUAL_C)
        air_c = _finite(ambient_c, temperature_c)
        for name, (most_w, hvch_watts) in self._sources.items():
            power_w = min(commands_w.get(name, 0.0), float(most_w(air_c, temperature_c)))
            drawn_w += power_w
            heat_w += power_w * float(hvch_watts(air_c, temperature_c))
        return drawn_w, heat_w


class Unheated:
    """
    How much warmer the battery is because of the heater, from its power so far.

    The equation is that of BatteryResponse: stored heat and leakage of the vehicle file; the change of
    the Joule heat by the few degrees is left out. It takes heat away at once, so it starts from the temperature
    that the battery settles at when the heat under way has arrived, as plans do: a reading shows heat late.
    `sources` are those of the vehicle beside the HVCH; None: none.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.sources = SourceHeat(vehicle) if vehicle.heat_sources else None
        self.restart()

    def restart(self) -> None:
        """Forget the heat, because another trip begins."""
        self._response = BatteryResponse(self._vehicle)
        self._latest_s: float | None = None

    def unheated_c(self, at_s: float, settled_c: float, soc: float, power_w: float,
                   heat_w: float | None = None) -> float:
        """
        Return the unheated temperature [deg C] (NaN: unknown), while the heat sources take `power_w` [W].

        `heat_w` is the HVCH power with their heat [W], None: it is the HVCH's alone; unknown with other sources,
        whose heat depends on the air.
        """
        if self._latest_s is not None and not 0.0 <= at_s - self._latest_s < UNHEATED_GAP_S:
            self.restart()
        self._latest_s = at_s
        return self._taken_c(at_s, settled_c, soc, power_w, heat_w)

    def _taken_c(self, at_s: float, settled_c: float, soc: float, power_w: float, heat_w: float | None) -> float:
        if heat_w is None and self.sources is not None:
            return math.nan
        # The difference of a car without the heater is negative.
        power_w = _finite(power_w, 0.0)
        heat_w = power_w if heat_w is None else _finite(heat_w, 0.0)
        self._response.advance(round(at_s * NS_PER_S), -power_w, -heat_w, soc, settled_c)
        return settled_c + self._response.temperature_k

    def planned_c(self, times_s: Sequence[float], temperatures_c: Sequence[float], socs: Sequence[float],
                  powers_w: Sequence[tuple[float, float | None]]) -> list[float]:
        """
        Return the unheated temperatures [deg C] at the instants of a plan.

        Instants [s], temperatures [deg C] and charges (0 ... 1) are (N + 1,), power and heat between them as in
        `unheated_c` (N,).
        """
        ahead = copy.copy(self)
        ahead._response = copy.copy(self._response)
        # Its steps may be longer than gaps of measurements.
        return [ahead._taken_c(at_s, temperature_c, soc, *taken_w) for at_s, temperature_c, soc, taken_w in zip(
            times_s, temperatures_c, socs, (*powers_w, *powers_w[-1:]))]


def _finite(value: float, otherwise: float) -> float:
    return value if math.isfinite(value) else otherwise
