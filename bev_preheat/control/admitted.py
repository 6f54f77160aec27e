# SPDX-License-Identifier: Apache-2.0
"""The valid inputs at an instant, as one immutable value."""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.inputs import goal_of_leg
from bev_preheat.control.settings import defaults_of

if TYPE_CHECKING:
    from bev_preheat.control.inputs import Leg, Measurement, Mission
    from bev_preheat.control.settings import Settings
    from bev_preheat.control.timetable import Timetable
    from bev_preheat.planning.situation import Goal
    from bev_preheat.vehicle.description import Defaults, Vehicle


class AdmittedInputs(NamedTuple):
    """
    The valid inputs and the refusals that hold the heater off.

    `timetable` is the route's; planning uses `active_timetable`, which is that of the preparation goal, or the
    route's without a goal. `measurement` has only the signals that hold; `doubt` is the sentence on a missing
    signal without which the heater stays off. `rivals` are other nodes that command the same heater.
    """

    vehicle: Vehicle
    settings: Settings
    is_enabled: bool
    rivals: str
    refusal: str | None
    is_cancelled: bool
    is_cancelled_before_restart: bool
    timetable: Timetable | None
    active_timetable: Timetable | None
    measurement: Measurement | None
    doubt: str | None = None

    @property
    def mission(self) -> Mission | None:
        """The current Mission of the route; None without a route."""
        return None if self.timetable is None else self.timetable.mission

    @property
    def defaults(self) -> Defaults:
        """The Defaults of vehicle and settings."""
        return defaults_of(self.vehicle, self.settings)

    def goal_of(self, leg: Leg) -> Goal:
        """Return the Goal of a leg; settings and vehicle complete it."""
        return goal_of_leg(leg, self.vehicle, self.settings)
