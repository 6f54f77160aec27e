# SPDX-License-Identifier: Apache-2.0
"""Follows a simulated drive over its topics and records it."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import BatteryState, Temperature

from bev_preheat.messages.fields import nanoseconds
from bev_preheat.messages.preheat_plan import charging_text
from bev_preheat.messages.simulated_drive import ARRIVED, DRIVING, outcome_from_diagnostics
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

if TYPE_CHECKING:
    from typing import Any

    from rclpy.node import Node

    from bev_preheat.messages.simulated_drive import SimulatedDriveReport


# Statuses of a planner without a trip to plan.
NOT_READY = (Status.NO_ROUTE, Status.NO_BATTERY_STATE)
# Messages of a topic that wait while the display is drawn.
UNREAD_MESSAGES = 1000
# Stamps are in whole nanoseconds, and segments add up with rounding.
ROUNDING_S = 1e-3


class ObservedDrive:
    """
    The drive as observed so far; instants are seconds after the start of the route.

    `states` holds (instant, temperature [deg C], state of charge), `commands` (instant, power
    [W]), `predictions` (instant, arrival temperature [deg C]). `route` is the RoutePlan,
    `first_plan` the first PreheatPlan for it and `plan` the latest one; `outcome` is the latest
    Outcome. `charging_plan` is the latest plan with a charging session from before any heating.
    None: not received yet. `heard_at_s` is when the vehicle last sent a message (time.monotonic).
    """

    def __init__(self) -> None:
        """Start without messages."""
        self.route: RoutePlan = None
        self.first_plan: PreheatPlan = None
        self.plan: PreheatPlan = None
        self.charging_plan: PreheatPlan = None
        self.latest_target_c = math.nan
        self.states: list[tuple[float, float, float]] = []
        self.commands: list[tuple[float, float]] = []
        self.predictions: list[tuple[float, float]] = []
        self.outcome: SimulatedDriveReport | None = None
        self.heard_at_s: float | None = None

    @property
    def start_ns(self) -> int:
        """Instant at which the route starts [ns]."""
        return nanoseconds(self.route.header.stamp)

    @property
    def duration_s(self) -> float:
        """Duration of the route [s]."""
        return math.fsum(self.route.segment_duration)

    @property
    def time_s(self) -> float:
        """Time since the start of the drive [s]."""
        return min(self.states[-1][0], self.duration_s) if self.states else 0.0

    @property
    def is_over(self) -> bool:
        """Whether the vehicle has stopped, and its last battery state has been received."""
        if self.has_arrived:
            return bool(self.states) and self.states[-1][0] >= self.duration_s - ROUNDING_S
        return self.outcome is not None and self.outcome.state != DRIVING

    @property
    def has_arrived(self) -> bool:
        """Whether the vehicle stands at the end of the route."""
        return self.outcome is not None and self.outcome.state == ARRIVED

    @property
    def target_c(self) -> float:
        """Latest target battery temperature on arrival [deg C], or NaN."""
        if math.isnan(self.latest_target_c) and self.first_plan is not None:
            return self.first_plan.target_battery_temperature
        return self.latest_target_c

    @property
    def switched_on_s(self) -> list[float]:
        """Instants at which the command went from 0 W to more [s]."""
        powers_w = [0.0] + [power_w for _, power_w in self.commands]
        return [instant_s for (instant_s, power_w), before_w in zip(self.commands, powers_w)
                if power_w > 0.0 and before_w == 0.0]


class Observer:
    """Fills an `ObservedDrive` from the topics of a node."""

    def __init__(self, node: Node) -> None:
        """Subscribe."""
        self.drive, self._has_heated = ObservedDrive(), False
        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        # Deeper than a vehicle in lockstep runs ahead of its listeners.
        every_plan = QoSProfile(depth=UNREAD_MESSAGES, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        subscribe = node.create_subscription
        subscribe(RoutePlan, 'route_plan', self._on_route, latched)
        subscribe(BatteryState, 'battery_state', self._on_state, UNREAD_MESSAGES)
        subscribe(DiagnosticArray, '/diagnostics', self._on_diagnostics, UNREAD_MESSAGES)
        self._from_planner = [
            subscribe(PreheatPlan, 'preheat_plan', self._on_plan, every_plan),
            subscribe(HvchCommand, 'hvch_command', self._on_command, UNREAD_MESSAGES),
            subscribe(Temperature, 'predicted_arrival_temperature', self._on_prediction, UNREAD_MESSAGES)]

    @property
    def hears_planner(self) -> bool:
        """Whether a planner is connected, so that its first plan will not be missed."""
        return all(subscription.get_publisher_count() for subscription in self._from_planner)

    def _on_route(self, message: RoutePlan) -> None:
        # A cancellation does not change the progress of the drive.
        if message.segment_duration:
            self.drive.route = message

    def _instant_s(self, message: Any) -> float | None:
        """Return seconds after the start of the route; None while the route is unknown."""
        if self.drive.route is None:
            return None
        return (nanoseconds(message.header.stamp) - self.drive.start_ns) * 1e-9

    def _on_plan(self, message: PreheatPlan) -> None:
        if message.status in NOT_READY:
            return
        if self.drive.first_plan is None and message.time:
            self.drive.first_plan = message
        self.drive.plan = message
        if math.isfinite(message.target_battery_temperature):
            self.drive.latest_target_c = message.target_battery_temperature
        # Commands may arrive earlier or later than the plan with the same stamp.
        if charging_text(message) and not self._has_heated:
            self.drive.charging_plan = message
        self._has_heated |= message.heating_planned and nanoseconds(
            message.heating_start) <= nanoseconds(message.header.stamp)

    def _on_state(self, message: BatteryState) -> None:
        self.drive.heard_at_s = time.monotonic()
        instant_s = self._instant_s(message)
        if instant_s is not None:
            self.drive.states.append((instant_s, message.temperature, message.percentage))

    def _on_command(self, message: HvchCommand) -> None:
        instant_s = self._instant_s(message)
        if instant_s is not None:
            self.drive.commands.append((instant_s, message.battery_heating_power))

    def _on_prediction(self, message: Temperature) -> None:
        instant_s = self._instant_s(message)
        if instant_s is not None:
            self.drive.predictions.append((instant_s, message.temperature))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        outcome = outcome_from_diagnostics(message)
        if outcome is not None:
            self.drive.outcome = outcome
