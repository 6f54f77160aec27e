# SPDX-License-Identifier: Apache-2.0
"""Whether the temperature follows the battery, by the drive and the heat that the battery's power shows."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
import math
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.estimation.readings import Resolution, TEMPERATURE_STEPS_K
from bev_preheat.estimation.stuck_temperature import StuckTemperature
from bev_preheat.numerics.arithmetic import SATURATING_FLOATS
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.numerics.folded_normal import mean_magnitude
from bev_preheat.tunables import COMPARED_EVERY_S, SEEN_OVER_S
from bev_preheat.vehicle.uncertain_car import make_drive_rates
from bev_preheat.vehicle.variants import KEPT_VEHICLES

if TYPE_CHECKING:
    from bev_preheat.control.inputs import Measurement
    from bev_preheat.vehicle.description import Vehicle
    from bev_preheat.vehicle.uncertain_car import DriveInputs, DriveRates


class TemperatureCheck(NamedTuple):
    """
    The StuckTemperature, with the steps of the sensor.

    `seen_w` is the battery's power beyond that of drive and consumers, `commanded_w` the heater's command, each
    over about SEEN_OVER_S [W]. `stamp_ns` [ns] is the instant of the latest battery state, None: unknown,
    `compared_ns` that of the latest comparison.
    """

    stuck: StuckTemperature = StuckTemperature()
    steps: Resolution = Resolution(TEMPERATURE_STEPS_K)
    seen_w: float = 0.0
    commanded_w: float = 0.0
    stamp_ns: int | None = None
    compared_ns: int = 0

    def without_instants(self) -> TemperatureCheck:
        """Return the check that starts again at the next battery state."""
        return self._replace(stuck=self.stuck.without_instants(), stamp_ns=None)

    def seen(self, measurement: Measurement, drive: DriveInputs | None, command_w: float,
             vehicle: Vehicle) -> TemperatureCheck:
        """Return the check after a Measurement in a drive under a command [W]; None: the drive is unknown."""
        state, now_ns, power_w = measurement.state, measurement.stamp_ns, measurement.power_w
        steps = self.steps.seen(state.temperature_c)
        if drive is None:
            return self._replace(stuck=self.stuck.without_instants(), steps=steps, stamp_ns=now_ns)
        seen_w, commanded_w = self.seen_w, self.commanded_w
        if power_w is not None:
            elapsed_s = 0.0 if self.stamp_ns is None else (now_ns - self.stamp_ns) / NS_PER_S
            share = 1.0 if elapsed_s <= 0.0 else 1.0 - math.exp(-elapsed_s / SEEN_OVER_S)
            others_w = drive.propulsion_power_w + drive.cabin_heating_power_w + drive.auxiliary_power_w
            seen_w += share * (power_w - others_w - seen_w)
            commanded_w += share * (command_w - commanded_w)
        if 0 <= now_ns - self.compared_ns < COMPARED_EVERY_S * NS_PER_S:
            return TemperatureCheck(self.stuck, steps, seen_w, commanded_w, now_ns, self.compared_ns)
        # The heater takes no more than the battery's power shows.
        heater_w = 0.0 if power_w is None else min(max(seen_w, 0.0), commanded_w)
        rate_k_per_s, _, _ = _rates(vehicle)(state.temperature_c, state.soc, (1.0,) * 5, replace(
            drive, heater_power_w=heater_w, terminal_power_w=power_w,
            power_variance_w2=0.0 if power_w is not None else drive.power_variance_w2))
        stuck = self.stuck.seen(
            now_ns / NS_PER_S, state.temperature_c, steps.step, rate_k_per_s, drive.ambient_temperature_c)
        return TemperatureCheck(stuck, steps, seen_w, commanded_w, now_ns, now_ns)


@lru_cache(maxsize=KEPT_VEHICLES)
def _rates(vehicle: Vehicle) -> DriveRates:
    return make_drive_rates(
        vehicle, SATURATING_FLOATS, lambda mean, variance: float(mean_magnitude(mean, variance)))
