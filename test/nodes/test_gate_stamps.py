# SPDX-License-Identifier: Apache-2.0
"""The battery state that heating_gates look at: coarse stamps keep the gates open, stale states close them."""

from types import SimpleNamespace

import pytest
from sensor_msgs.msg import BatteryState

from bev_preheat.messages.fields import time_message
from bev_preheat.nodes import gate_inputs
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.vehicle.heater_controller import Instant, Refusal
from bev_preheat.vehicle.heating_gates import HeatingGates

START_NS, TIMEOUT_S = 1_700_000_000 * NS_PER_S, 5.0


class Gates:
    """GateInputs behind a node that is only a clock."""

    def __init__(self, monkeypatch):
        self.now_s, self.told = 0.0, []
        clock = SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=self.now.clock_ns))
        node = SimpleNamespace(create_subscription=lambda *arguments: None, get_clock=lambda: clock)
        monkeypatch.setattr(gate_inputs.time, 'monotonic', lambda: self.now_s)
        self.inputs = gate_inputs.GateInputs(node, HeatingGates(minimum_soc=0.1), TIMEOUT_S, self.told.append)

    @property
    def now(self):
        return Instant(START_NS + round(self.now_s * NS_PER_S), round(self.now_s * NS_PER_S))

    def refusal(self, arrives_s, stamp_s, look_s):
        """Return the Refusal at an instant [s], after a state of another instant with a stamp [s] arrived."""
        message = BatteryState(temperature=0.0, percentage=0.5)
        message.header.stamp = time_message(START_NS + round(stamp_s * NS_PER_S))
        self.now_s = arrives_s
        self.inputs.on_battery_state(message)
        self.now_s = look_s
        return self.inputs.verdict(self.now).refusal


@pytest.mark.parametrize('arrives_s, stamp_s, look_s, is_open', [
    (10.0, 10.0, 14.99, True), (10.0, 10.0, 15.01, False),
    # 4.9 s old on arrival: for 2 s more.
    (10.0, 5.1, 11.99, True), (10.0, 5.1, 12.01, False),
    # Too old on arrival, or too far ahead.
    (10.0, 4.9, 10.0, False), (10.0, 15.1, 10.0, False)])
def test_gates_close_once_the_state_has_expired(monkeypatch, arrives_s, stamp_s, look_s, is_open):
    gates = Gates(monkeypatch)
    assert (gates.refusal(arrives_s, stamp_s, look_s) is Refusal.NOT_REFUSED) is is_open
    assert bool(gates.told) is (abs(arrives_s - stamp_s) > TIMEOUT_S)
