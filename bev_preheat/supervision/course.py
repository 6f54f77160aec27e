# SPDX-License-Identifier: Apache-2.0
"""The drive that the route plans between two instants, for the estimator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bev_preheat.estimation.estimator import Stretch
from bev_preheat.estimation.state import DriveInputs
from bev_preheat.supervision.inputs import Mission, NS_PER_S

if TYPE_CHECKING:
    from bev_preheat.supervision.command_history import CommandHistory
    from bev_preheat.vehicle.description import Vehicle


def stretches_between(edges_ns: Sequence[int], vehicle: Vehicle, mission: Mission | None,
                      commands: CommandHistory) -> tuple[Stretch, ...]:
    """
    Return the estimation.estimator.Stretch between each of the instants [ns] and the next.

    `mission` is None where there is no route; `commands` is the CommandHistory.
    """
    stretches = []
    for from_ns, to_ns in zip(edges_ns, edges_ns[1:]):
        drive, limit_w = _planned_between(vehicle, mission, from_ns, to_ns)
        stretches.append(Stretch((to_ns - from_ns) / NS_PER_S, drive,
                                 commands.mean_w(from_ns, to_ns), limit_w))
    return tuple(stretches)


def _planned_between(vehicle: Vehicle, mission: Mission | None, from_ns: int,
                     to_ns: int) -> tuple[DriveInputs | None, float]:
    """
    Return (DriveInputs, heater power left by the cabin [W]) for the middle of two instants [ns].

    (None, 0.0) where no route covers it: before its start, at stops, after its end.
    """
    middle_ns = (from_ns + to_ns) // 2
    if mission is None or middle_ns < mission.start_ns:
        return None, 0.0
    leg = mission.legs[mission.leg_number(middle_ns)]
    if leg.ended_for_s(middle_ns) >= 0.0:
        return None, 0.0
    route = leg.route
    at = route.segment_at((middle_ns - leg.start_ns) / NS_PER_S)
    power_w = float(route.propulsion_power_w[at])
    rms_w = float(route.propulsion_power_rms_w[at])
    cabin_w = float(route.cabin_heating_power_w[at])
    drive = DriveInputs(
        speed_mps=float(route.speed_mps[at]),
        ambient_temperature_c=float(route.ambient_temperature_c[at]),
        propulsion_power_w=power_w,
        power_variance_w2=max(rms_w**2 - power_w**2, 0.0),
        propulsion_power_magnitude_w=float(route.propulsion_power_magnitude_w[at]),
        cabin_heating_power_w=cabin_w,
        auxiliary_power_w=float(route.auxiliary_power_w[at]),
        heater_power_w=0.0)
    return drive, max(0.0, vehicle.hvch.maximum_power_w - cabin_w)
