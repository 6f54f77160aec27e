# SPDX-License-Identifier: Apache-2.0
"""The planner's knowledge of the car from battery states: the estimate, and the time at stand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from bev_preheat.control.expected_drive import intervals_between
from bev_preheat.control.soak_watch import StandWatch
from bev_preheat.estimation.estimator import Estimator
from bev_preheat.estimation.last_seen import LastSeen

if TYPE_CHECKING:
    from bev_preheat.control.command_history import CommandHistory
    from bev_preheat.control.inputs import Mission
    from bev_preheat.control.knowledge import Known
    from bev_preheat.control.timetable import Timetable
    from bev_preheat.estimation.prior import Learned
    from bev_preheat.vehicle.description import Vehicle


@dataclass(frozen=True, eq=False)
class Learning:
    """The Estimator of a vehicle, and the watch over the first battery state of each trip; a value."""

    estimator: Estimator
    stand_watch: StandWatch

    @classmethod
    def begun(cls, vehicle: Vehicle, learned: Learned | None = None,
              last_seen: LastSeen | None = None) -> Learning:
        """Return the Learning of a vehicle file, or of the Learned of earlier drives, and of the LastSeen."""
        return cls(Estimator.of(vehicle, learned), StandWatch(() if last_seen is None else (last_seen,)))

    def learned(self, vehicle: Vehicle, known: Known, timetable: Timetable | None, commands: CommandHistory,
                trip: Mission | None) -> Learning:
        """
        Return the Learning after a Known measurement, on a Timetable's mission and under a CommandHistory.

        `trip` is the Mission of the route plan, before which the vehicle may have stood.
        """
        measurement, estimator, stand_watch, standing = known.measurement, self.estimator, self.stand_watch, None
        if known.trusts_temperature:
            stand_watch, standing = stand_watch.compared(trip, measurement, vehicle)
        if standing is not None:
            estimator = estimator.after_soak(standing)
        if known.is_open:
            # The next state that is clear is compared with the latest one before this.
            return Learning(estimator, stand_watch)
        if timetable is not None and timetable.mission.legs[0].terms.is_from_grid:
            # Then the battery's power does not show the heater's.
            measurement = replace(measurement, voltage_v=None, current_a=None)
        if known.is_described:
            estimator = estimator.observed(measurement, intervals_between(
                estimator.edges_ns(measurement.stamp_ns), vehicle, timetable, commands), vehicle)
        else:
            estimator = estimator.held(measurement, vehicle, known.trusts_temperature, known.trusts_soc)
        estimate = estimator.estimate
        if estimate is not None:
            stand_watch = stand_watch.noted(LastSeen(estimate.temperature_c, estimate.soc, estimate.stamp_ns))
        return Learning(estimator, stand_watch)

    def on_new_trip(self) -> Learning:
        """Return the Learning without the consumption of the route before: another trip begins."""
        return replace(self, estimator=self.estimator.of_another_route())

    def with_acquitted_heater(self) -> Learning:
        """Return the Learning of a healthy heater: the power with which it was compared is refuted."""
        return replace(self, estimator=self.estimator.of_healthy_heater())

    def without_instants(self) -> Learning:
        """Return the Learning without instants, because the clock was restarted."""
        return replace(self, estimator=self.estimator.without_instants())
