# SPDX-License-Identifier: Apache-2.0
"""Learning of the car from battery states: the estimate, and the soak before each trip."""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.expected_drive import intervals_between
from bev_preheat.estimation.before_restart import LastSeen
from bev_preheat.estimation.estimator import Estimator
from bev_preheat.estimation.soak import after_soak, Soak
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.tunables import CONTRADICTS_BEYOND_K, LONGEST_GAP_S, MOST_NOTED, NOTED_EVERY_S, PARKED_WITHIN_S

if TYPE_CHECKING:
    from bev_preheat.control.heater_power import CommandHistory
    from bev_preheat.control.inputs import Measurement, Mission
    from bev_preheat.control.knowledge import Known
    from bev_preheat.control.timetable import Timetable
    from bev_preheat.estimation.prior import Learned
    from bev_preheat.vehicle.description import Vehicle


class StandReport(NamedTuple):
    """A temperature [deg C] read after `stood_s` [s] at `ambient_c` [deg C], and the Soak."""

    reading_c: float
    stood_s: float
    ambient_c: float
    standing: Soak

    @property
    def contradiction(self) -> str:
        """The sentence on a sensor that contradicts the standing time; '' without a contradiction."""
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


class StandWatch(NamedTuple):
    """
    Temperatures before each trip; `report` is the StandReport of the current trip.

    `history` are LastSeens of the last days, in order, and `latest` is the latest one; `history` may begin with
    the one before a restart. `is_done`: the first battery state of the trip with `route_id` was compared.
    """

    history: tuple[LastSeen, ...] = ()
    latest: LastSeen | None = None
    route_id: str | None = None
    is_done: bool = False
    report: StandReport | None = None

    def noted(self, seen: LastSeen) -> StandWatch:
        """Return the watch after a LastSeen, later than those before: the vehicle may be parked then."""
        history, latest = self.history, self.latest
        if latest is not None and (
                seen.stamp_ns < latest.stamp_ns or seen.stamp_ns - latest.stamp_ns > LONGEST_GAP_S * NS_PER_S):
            history = (*history, latest)
        if history and seen.stamp_ns < history[-1].stamp_ns:
            # The clock was set back.
            history = ()
        if not history or seen.stamp_ns - history[-1].stamp_ns >= NOTED_EVERY_S * NS_PER_S:
            history = (*history, seen)
        return self._replace(history=history[-MOST_NOTED:], latest=seen)

    def _parked(self, parked_ns: int) -> LastSeen | None:
        """Return the latest LastSeen of about the instant [ns] at which the vehicle was parked; None: unknown."""
        return next((seen for seen in reversed(self.history)
                     if abs(seen.stamp_ns - parked_ns) <= PARKED_WITHIN_S * NS_PER_S), None)

    def compared(self, mission: Mission | None, measurement: Measurement,
                 vehicle: Vehicle) -> tuple[StandWatch, Soak | None]:
        """
        Return the watch after a Measurement, and the Soak before it; None if it does not follow a soak.

        It is returned at most once per trip, because an update of the route adds no information.
        """
        route_id = None if mission is None else mission.route_id
        watch = self if route_id == self.route_id else self._replace(
            route_id=route_id, is_done=False, report=None)
        if mission is None or watch.is_done:
            return watch, None
        since_start_s = (measurement.stamp_ns - mission.start_ns) / NS_PER_S
        if since_start_s > LONGEST_GAP_S:
            return watch._replace(is_done=True), None
        stood_s = mission.standing_time_s + min(since_start_s, 0.0)
        if mission.standing_time_s == 0.0 or stood_s <= 0.0:
            return watch, None
        ambient_c = float(mission.legs[0].route.ambient_temperature_c[0])
        parked = self._parked(measurement.stamp_ns - round(stood_s * NS_PER_S))
        parked_c = None
        if parked is not None:
            stood_s, parked_c = (measurement.stamp_ns - parked.stamp_ns) / NS_PER_S, parked.temperature_c
        standing = after_soak(vehicle, ambient_c, stood_s, parked_c)
        return watch._replace(is_done=True, report=StandReport(
            measurement.state.temperature_c, stood_s, ambient_c, standing)), standing


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
