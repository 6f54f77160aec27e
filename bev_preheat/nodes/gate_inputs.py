# SPDX-License-Identifier: Apache-2.0
"""Battery state and speed for the heating_gates of a vehicle, and their verdict."""

from __future__ import annotations

from dataclasses import replace
import math
import time
from typing import TYPE_CHECKING

from rclpy.qos import qos_profile_sensor_data, QoSProfile
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64

from bev_preheat.errors import age_beyond, InvalidInput
from bev_preheat.messages.battery_state import measurement_from_message
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.vehicle.heater_controller import Refusal, Verdict

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

    from bev_preheat.control.inputs import Measurement
    from bev_preheat.vehicle.heater_controller import Instant
    from bev_preheat.vehicle.heating_gates import HeatingGates


class GateInputs:
    """Subscribes to the inputs of the gates; `topics` are the names."""

    def __init__(self, node: Node, gates: HeatingGates, timeout_s: float, tell: Callable[[str], None]) -> None:
        """Subscribe; values older than `timeout_s` [s] close the gates, and `tell` logs a sentence."""
        self._node, self._gates, self._timeout_s, self._tell = node, gates, timeout_s, tell
        self._measurement: Measurement | None = None
        self._measured_at_s = self._speed_at_s = -math.inf
        self._speed_mps = math.nan
        self.topics: list[str] = []
        best_effort = QoSProfile(depth=1, reliability=qos_profile_sensor_data.reliability)
        if gates.looks_at_battery:
            node.create_subscription(BatteryState, 'battery_state', self.on_battery_state, best_effort)
            self.topics.append('battery_state')
        if gates.only_while_standing:
            node.create_subscription(Float64, 'vehicle_speed', self._on_speed, best_effort)
            self.topics.append('vehicle_speed')

    def on_battery_state(self, message: BatteryState) -> None:
        """Take a battery state in, or the reason for its refusal."""
        now_ns = self._node.get_clock().now().nanoseconds
        try:
            measurement = measurement_from_message(message)
            age_s, most_s = (now_ns - measurement.stamp_ns) / NS_PER_S, self._timeout_s
            if abs(age_s) > most_s:
                raise InvalidInput(f'header.stamp: the state is {age_beyond(age_s, most_s, most_s)}')
            self._measurement = replace(measurement, arrived_ns=now_ns)
        except InvalidInput as error:
            self._tell(f'battery_state refused: {error}')
            self._measurement = None
        self._measured_at_s = time.monotonic()

    def _on_speed(self, message: Float64) -> None:
        self._speed_mps, self._speed_at_s = message.data, time.monotonic()

    def verdict(self, now: Instant) -> Verdict:
        """Return the gates' Verdict; without the values that they need they are closed."""
        gates, now_s = self._gates, now.steady_ns / NS_PER_S
        soc = temperature_c = speed_mps = math.nan
        if gates.looks_at_battery:
            measurement = self._measurement
            if measurement is None or now_s - self._measured_at_s > self._timeout_s or not (
                    measurement.stamp_ns - now.clock_ns <= self._timeout_s * NS_PER_S
                    and now.clock_ns < measurement.expires_ns(self._timeout_s)):
                return Verdict(Refusal.OTHER, 'no valid battery_state, which heating_gates need')
            soc, temperature_c = measurement.state.soc, measurement.state.temperature_c
        if gates.only_while_standing:
            if now_s - self._speed_at_s > self._timeout_s:
                return Verdict(Refusal.OTHER, 'no vehicle_speed, which heating_gates need')
            speed_mps = self._speed_mps
        return gates.verdict(soc, temperature_c, speed_mps)
