# SPDX-License-Identifier: Apache-2.0
"""The obstacle: the valid inputs of an instant, and the reason for an off heater."""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.decision import Decision, WITHOUT_ROUTE
from bev_preheat.control.inputs import goal_of_leg
from bev_preheat.control.settings import defaults_of
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat.vehicle.variants import with_sources_at

if TYPE_CHECKING:
    from bev_preheat.control.inputs import Leg, Measurement, Mission
    from bev_preheat.control.settings import Settings
    from bev_preheat.control.timetable import Timetable
    from bev_preheat.estimation.hypotheses import SuspectedFault
    from bev_preheat.planning.situation import Goal
    from bev_preheat.vehicle.description import Defaults, Vehicle


class Unserved(NamedTuple):
    """
    A heat source beside the HVCH that does not heat or cool as commanded, and the sentence on it.

    It delivers a `share` of its command, 0: nothing; `is_refused`: it says so itself.
    """

    name: str
    sentence: str
    is_refused: bool
    share: float = 0.0


class AdmittedInputs(NamedTuple):
    """
    The valid inputs and the refusals that hold the heater off.

    `timetable` is the route's; planning uses `active_timetable`, which is that of the preparation goal, or the
    route's without a goal. `measurement` has only the signals that hold; `doubt` is the sentence on a missing
    signal without which the heater stays off. `rivals` are other nodes that command the same heater.
    `heater_refusal` is the sentence on heat that the heater refuses, `inactive` that on a managed node that may
    not heat; '' for none. `unserved` are the heat sources beside the HVCH without which plans are made.
    `suspected` are the faults of heat sources that are not reported yet, by name.
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
    heater_refusal: str = ''
    inactive: str = ''
    unserved: tuple[Unserved, ...] = ()
    suspected: tuple[tuple[str, SuspectedFault], ...] = ()

    @property
    def heating_vehicle(self) -> Vehicle:
        """The vehicle with the sources as far as they serve."""
        return with_sources_at(self.vehicle, tuple((each.name, each.share) for each in self.unserved))

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


def find_obstacle(inputs: AdmittedInputs, now_ns: int) -> Decision | None:
    """Return a Decision that keeps the heater off at an instant [ns]; None if nothing forbids heating."""
    if inputs.inactive:
        return Decision(Status.DISABLED, inputs.inactive)
    if not inputs.is_enabled:
        return Decision(Status.DISABLED, 'Preheating is switched off through ~/enable.')
    if inputs.rivals:
        return Decision(Status.COMMAND_CONFLICT, 'Heat is also commanded by '
                        f'{inputs.rivals}; the heater is off until only one is left.')
    if inputs.refusal is not None:
        return Decision(Status.INVALID_INPUT, inputs.refusal)
    if inputs.active_timetable is None:
        return _cancelled(inputs) if inputs.is_cancelled else WITHOUT_ROUTE
    if inputs.measurement is None:
        return Decision(Status.NO_BATTERY_STATE, 'No valid battery state has arrived yet.')
    age_s = (now_ns - inputs.measurement.stamp_ns) / NS_PER_S
    timeout_s, tolerance_s = inputs.settings.battery_state_timeout_s, inputs.settings.clock_tolerance_s
    if now_ns >= inputs.measurement.expires_ns(timeout_s):
        also = '' if inputs.doubt is None else f' {inputs.doubt}'
        return Decision(Status.STALE_INPUT, f'battery_state is {age_s:.3f} s old; less than '
                        f'{timeout_s:g} s are allowed.{also}')
    if age_s < -tolerance_s:
        return Decision(Status.STALE_INPUT, f'battery_state is stamped {-age_s:.3f} s ahead '
                        f'of the clock; at most {tolerance_s:g} s are allowed.')
    if inputs.doubt is not None:
        return Decision(Status.INVALID_INPUT, inputs.doubt)
    return None


def _cancelled(inputs: AdmittedInputs) -> Decision:
    before, wanted = (' before the planner restarted', 'route plan with another stamp'
                      ) if inputs.is_cancelled_before_restart else ('', 'new route plan')
    return Decision(Status.NO_CHARGING_PLANNED,
                    f'The trip was cancelled{before}: no heating until a {wanted} arrives.')
