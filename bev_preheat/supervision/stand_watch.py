# SPDX-License-Identifier: Apache-2.0
"""Holds the first battery state of a trip against the time that the vehicle stood before it."""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.estimation.standing import after_standing, Standing
from bev_preheat.planning.explanation import duration_text
from bev_preheat.supervision.inputs import NS_PER_S

if TYPE_CHECKING:
    from bev_preheat.supervision.inputs import Measurement, Mission
    from bev_preheat.vehicle.description import Vehicle

# A state that comes later than this after the start [s] is no longer one of a battery that stood.
FIRST_STATE_WITHIN_S = 60.0
# A sensor contradicts the standing time beyond this [K], and a standard deviation of what is left of
# the temperature with which the battery was parked.
CONTRADICTS_BEYOND_K = 2.0


class StandReport(NamedTuple):
    """A temperature [deg C] that was read after `stood_s` [s] at `ambient_c` [deg C], and Standing."""

    reading_c: float
    stood_s: float
    ambient_c: float
    standing: Standing

    @property
    def contradiction(self) -> str:
        """The sentence on a sensor that contradicts the standing time; '' where it does not."""
        expected_c = self.standing.temperature_c
        allowed_k = CONTRADICTS_BEYOND_K + self.standing.left_deviation_k
        difference_k = self.reading_c - expected_c
        if abs(difference_k) <= allowed_k:
            return ''
        direction = 'warmer' if difference_k > 0.0 else 'colder'
        return (f'battery_state.temperature was {self.reading_c:.1f} degC after '
                f'{duration_text(self.stood_s)} of standing at {self.ambient_c:.1f} degC: '
                f'{abs(difference_k):.1f} K {direction} than the {expected_c:.1f} degC expected, '
                f'{allowed_k:.1f} K are allowed; check the sensor, and standing_time of route_plan')


class StandWatch:
    """Looks at the first battery state of each trip; `report` is the StandReport of this one."""

    def __init__(self, vehicle: Vehicle) -> None:
        """Start without a trip."""
        self._vehicle = vehicle
        self._route_id: str | None = None
        self._is_done = False
        self.report: StandReport | None = None

    def look(self, mission: Mission | None, measurement: Measurement) -> Standing | None:
        """
        Return the Standing that a Measurement is of; None where it is not of a battery that stood.

        That is so at most once in a trip: an update of its route tells nothing new.
        """
        route_id = None if mission is None else mission.route_id
        if route_id != self._route_id:
            self._route_id, self._is_done, self.report = route_id, False, None
        if mission is None or self._is_done:
            return None
        since_start_s = (measurement.stamp_ns - mission.start_ns) / NS_PER_S
        self._is_done = since_start_s > FIRST_STATE_WITHIN_S
        stood_s = mission.standing_time_s + min(since_start_s, 0.0)
        if self._is_done or mission.standing_time_s == 0.0 or stood_s <= 0.0:
            return None
        self._is_done = True
        ambient_c = float(mission.legs[0].route.ambient_temperature_c[0])
        standing = after_standing(self._vehicle, ambient_c, stood_s)
        self.report = StandReport(
            measurement.state.temperature_c, stood_s, ambient_c, standing)
        return standing
