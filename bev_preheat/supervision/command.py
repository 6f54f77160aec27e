# SPDX-License-Identifier: Apache-2.0
"""
The one gate between plans and the heater: 0 W unless every condition for heating holds.

`find_obstacle` says why the heater is off whatever a plan says; `Commander` turns a decision into a
command with a lease. Nothing is planned here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.planning.status import Status
from bev_preheat.supervision.command_history import CommandHistory
from bev_preheat.supervision.decision import Command, Decision, WITHOUT_ROUTE
from bev_preheat.supervision.heater_switch import HeaterSwitch
from bev_preheat.supervision.inputs import Leg, NS_PER_S

if TYPE_CHECKING:
    from bev_preheat.supervision.inbox import Inbox
    from bev_preheat.vehicle.description import Vehicle


def find_obstacle(inbox: Inbox, now_ns: int) -> Decision | None:
    """Return a Decision that keeps the heater off at an instant [ns]; None if nothing forbids heating."""
    if not inbox.is_enabled:
        return Decision(Status.DISABLED, 'Preheating is switched off through ~/enable.')
    if inbox.rivals:
        return Decision(Status.COMMAND_CONFLICT, 'hvch_command is also published by '
                        f'{inbox.rivals}; the heater is off until only one is left.')
    if inbox.refusal is not None:
        return Decision(Status.INVALID_INPUT, inbox.refusal)
    if inbox.pursued is None:
        return _cancelled(inbox) if inbox.is_cancelled else WITHOUT_ROUTE
    if inbox.measurement is None:
        return Decision(Status.NO_BATTERY_STATE, 'No valid battery state has arrived yet.')
    age_s = (now_ns - inbox.measurement.stamp_ns) / NS_PER_S
    timeout_s, tolerance_s = inbox.settings.battery_state_timeout_s, inbox.settings.clock_tolerance_s
    if age_s >= timeout_s:
        return Decision(Status.STALE_INPUT, f'battery_state is {age_s:.3f} s old; less than '
                        f'{timeout_s:g} s are allowed.')
    if age_s < -tolerance_s:
        return Decision(Status.STALE_INPUT, f'battery_state is stamped {-age_s:.3f} s ahead '
                        f'of the clock; at most {tolerance_s:g} s are allowed.')
    if inbox.doubt is not None:
        return Decision(Status.INVALID_INPUT, inbox.doubt)
    return None


def _cancelled(inbox: Inbox) -> Decision:
    before, wanted = (' before the planner restarted', 'route plan with another stamp'
                      ) if inbox.is_cancelled_before_restart else ('', 'new route plan')
    return Decision(Status.NO_CHARGING_PLANNED,
                    f'The trip was cancelled{before}: no heating until a {wanted} arrives.')


class Commander:
    """Gives the heater's commands and remembers them; instants in nanoseconds."""

    def __init__(self) -> None:
        """Start with the heater off."""
        self.history = CommandHistory()
        self._switch = HeaterSwitch()

    @property
    def is_heating(self) -> bool:
        """Whether the heater is switched on."""
        return self._switch.is_on

    def allow_switching(self) -> None:
        """Let the heater be switched at once: the reason for its waiting time is gone."""
        self._switch.allow()

    def off(self, now_ns: int, lease_s: float, reason: Status) -> Command:
        """Return a Command of 0 W for a reason; it counts as given."""
        self._switch.force_off()
        self.history.note(now_ns, 0.0)
        return Command(0.0, now_ns + round(lease_s * NS_PER_S), reason)

    def give(self, now_ns: int, inbox: Inbox, decision: Decision) -> Command:
        """Return the Command that a Decision allows at an instant; it counts as given."""
        settings = inbox.settings
        decision = find_obstacle(inbox, now_ns) or decision
        if decision.charger_heat_w > 0.0 and not _has_departed(decision, now_ns):
            return self._heat_at_charger(now_ns, inbox, decision)
        reason = self._reason_for_off(now_ns, decision)
        if reason is not None:
            return self.off(now_ns, settings.lease_s, reason)
        plan = decision.commanded or decision.plan
        assert plan is not None and decision.leg is not None
        # A partial step's power is computed and may round to slightly more than the limit.
        limit_w = _heater_limit_w(inbox.vehicle, decision.leg, now_ns)
        elapsed_s = (now_ns - decision.plan_start_ns) / NS_PER_S
        wanted_w = min(plan.power_at_w(elapsed_s) / decision.command_share, limit_w)
        if wanted_w == 0.0 and decision.status is Status.OUT_OF_CHARGE:
            # Not even for the heater's minimum time on: each watt-hour is needed to get further.
            return self.off(now_ns, settings.lease_s, decision.status)
        power_w = self._switch.power_w(
            now_ns, wanted_w, limit_w, settings.minimum_on_time_s, settings.minimum_off_time_s)
        self.history.note(now_ns, power_w)
        reason = decision.status
        if power_w > 0.0 and reason is Status.WAITING:
            reason = Status.HEATING
        elif power_w == 0.0 and reason is Status.HEATING:
            reason = Status.WAITING
        return Command(power_w, _lease_end_ns(now_ns, inbox), reason)

    def _heat_at_charger(self, now_ns: int, inbox: Inbox, decision: Decision) -> Command:
        """Return the Command of a Decision that heats while the vehicle charges."""
        settings, wanted_w = inbox.settings, decision.charger_heat_w
        power_w = self._switch.power_w(
            now_ns, wanted_w, wanted_w, settings.minimum_on_time_s, settings.minimum_off_time_s)
        self.history.note(now_ns, power_w)
        return Command(power_w, _lease_end_ns(now_ns, inbox), decision.status)

    @staticmethod
    def _reason_for_off(now_ns: int, decision: Decision) -> Status | None:
        """Return the Status that keeps the heater off under a Decision; None if it may heat."""
        plan = decision.commanded or decision.plan
        if plan is None:
            return decision.status
        elapsed_s = (now_ns - decision.plan_start_ns) / NS_PER_S
        if elapsed_s >= plan.arrival_time_s:
            return Status.CHARGING if decision.later_legs else Status.ARRIVED
        # Before the trip begins, and where charging is not planned or heating for it does not pay,
        # there is nothing to heat for.
        if elapsed_s < 0.0 or decision.status in (
                Status.NO_CHARGING_PLANNED, Status.NOT_WORTH_IT):
            return decision.status
        return None


def _lease_end_ns(now_ns: int, inbox: Inbox) -> int:
    """Return the instant [ns] until which a command of now may be used."""
    settings, measurement = inbox.settings, inbox.measurement
    assert measurement is not None
    # No lease outlives the battery state that it rests on.
    stale_ns = measurement.stamp_ns + round(settings.battery_state_timeout_s * NS_PER_S)
    return min(now_ns + round(settings.lease_s * NS_PER_S), stale_ns)


def _has_departed(decision: Decision, now_ns: int) -> bool:
    """Return whether the stop of a Decision is over at an instant [ns]."""
    return bool(decision.later_legs) and now_ns >= decision.later_legs[0].start_ns


def _heater_limit_w(vehicle: Vehicle, leg: Leg, now_ns: int) -> float:
    """Return the heater power that the cabin leaves [W] at an instant on a leg."""
    segment = leg.route.segment_at((now_ns - leg.start_ns) / NS_PER_S)
    cabin_w = float(leg.route.cabin_heating_power_w[segment])
    return max(0.0, vehicle.hvch.maximum_power_w - cabin_w)
