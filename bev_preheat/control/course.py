# SPDX-License-Identifier: Apache-2.0
"""What the car was meant to do between two instants: the route, seen by the estimator."""

from bev_preheat.control.inputs import NS_PER_S
from bev_preheat.estimation.state import Drive


class Course:
    """The course of a Mission driven by a Vehicle; the mission is None where there is no route."""

    def __init__(self, vehicle, mission):
        """Take vehicle and mission."""
        self._vehicle, self._mission = vehicle, mission

    def between(self, from_ns, to_ns):
        """
        Return (Drive, what the cabin leaves of the heater [W]) for the middle of two instants.

        (None, 0.0) where no route says what happens: before its start, at stops, after its end.
        """
        middle_ns = (from_ns + to_ns) // 2
        if self._mission is None or middle_ns < self._mission.start_ns:
            return None, 0.0
        leg = self._mission.legs[self._mission.leg_number(middle_ns)]
        if leg.ended_for_s(middle_ns) >= 0.0:
            return None, 0.0
        route = leg.route
        at = route.segment_at((middle_ns - leg.start_ns) / NS_PER_S)
        power_w = float(route.propulsion_power_w[at])
        rms_w = float(route.propulsion_power_rms_w[at])
        cabin_w = float(route.cabin_heating_power_w[at])
        drive = Drive(
            speed_mps=float(route.speed_mps[at]),
            ambient_temperature_c=float(route.ambient_temperature_c[at]),
            propulsion_power_w=power_w,
            power_variance_w2=max(rms_w**2 - power_w**2, 0.0),
            cabin_heating_power_w=cabin_w,
            auxiliary_power_w=float(route.auxiliary_power_w[at]),
            heater_power_w=0.0)
        return drive, max(0.0, self._vehicle.hvch.maximum_power_w - cabin_w)
