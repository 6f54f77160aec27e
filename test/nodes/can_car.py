# SPDX-License-Identifier: Apache-2.0
"""
A car on CAN that plays itself: battery and heater by physics of its own, frames packed bit by bit.

Its frames share no code with the project. Both adapters are on one bus: each hears every frame of the car, and the
frames of either reach the heater.
"""

import math
import threading
import time

from example_frames import (
    COMMAND,
    heater_frame,
    HEATER_STATUS,
    read_command,
    STATUS,
    status_frame,
    temperature_frame,
    TEMPERATURES,
)
from slcan_port import SlcanPort

PERIOD_S = 0.1
# The heater's own timeout: without a new frame it is off.
HEATER_TIMEOUT_S = 0.5
HEATER_EFFICIENCY, LEAKAGE_W_PER_K, VOLTAGE_V, RESISTANCE_OHM = 0.87, 20.0, 400.0, 0.1


class CanCar:
    """The car; `heated` has (instant [s, time.monotonic], power [W]) of each step."""

    def __init__(self, temperature_c, heat_capacity_j_per_k, ambient_c, load_w, heat_lag_s, adapters):
        """Start to play; `load_w` [W] is drawn besides the heater, whose heat arrives `heat_lag_s` [s] late."""
        self.ports = [SlcanPort() for _ in range(adapters)]
        self.temperature_c, self.soc = temperature_c, 0.8
        self._heat_capacity_j_per_k, self._ambient_c, self._load_w = heat_capacity_j_per_k, ambient_c, load_w
        self._heat_lag_s, self._arriving_w = heat_lag_s, 0.0
        self.power_w, self.refusal, self.heated = 0.0, 0, []
        self._commanded_w, self._heard_s, self._counts, self.current_a = 0.0, -math.inf, {}, 0.0
        self._looked_at = [0] * adapters
        self.bad_frames = 0
        # Whether its temperature and charge stay.
        self.rests = False
        # Whether the checksums of the battery's frames are wrong.
        self.is_attacked = False
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._play, daemon=True)
        self._thread.start()

    def close(self):
        self._ended.set()
        self._thread.join()
        for port in self.ports:
            port.close()

    def powers_since(self, instant_s):
        """Return (instant, power [W]) of the steps since an instant."""
        return [(at_s, power_w) for at_s, power_w in list(self.heated) if at_s >= instant_s]

    def wait_for_power(self, power_w):
        return self.ports[0].wait_for(
            lambda identifier, data: identifier == COMMAND and read_command(data)[0] == power_w)[0]

    def commands(self):
        return [read_command(data) for _, identifier, data in list(self.ports[0].frames) if identifier == COMMAND]

    def _play(self):
        count, before_s = 0, time.monotonic()
        while not self._ended.wait(PERIOD_S):
            now_s = time.monotonic()
            self._hear(now_s)
            if not self.rests:
                self._pass(now_s - before_s)
            self.heated.append((now_s, self.power_w))
            before_s, count = now_s, count + 1
            self._say(HEATER_STATUS, heater_frame(self.power_w, count % 16, self.refusal))
            self._say_battery(count)

    def _say_battery(self, count):
        frames = [(STATUS, status_frame(self.soc, VOLTAGE_V, self.current_a, count % 16))]
        if count % 5 == 0:
            frames.append((TEMPERATURES, temperature_frame(
                self.temperature_c, count // 5 % 16, self.temperature_c - 1.5, self.temperature_c + 1.5)))
        for identifier, data in frames:
            self._say(identifier, data[:-1] + bytes([data[-1] ^ self.is_attacked]))

    def _say(self, identifier, data):
        for port in self.ports:
            port.send(identifier, data)

    def _hear(self, now_s):
        """Take the commands of both adapters: a right checksum, and a counter that counts."""
        for number, port in enumerate(self.ports):
            frames = list(port.frames)
            for at_s, identifier, data in frames[self._looked_at[number]:]:
                if identifier != COMMAND:
                    continue
                power_w, enabled, count, is_right = read_command(data)
                if not is_right or self._counts.get(number) == count:
                    self.bad_frames += 1
                    continue
                self._counts[number] = count
                self._commanded_w, self._heard_s = power_w if enabled else 0.0, at_s
            self._looked_at[number] = len(frames)
        is_silent = now_s - self._heard_s > HEATER_TIMEOUT_S
        self.power_w = 0.0 if is_silent or self.refusal else self._commanded_w

    def _pass(self, elapsed_s):
        self.current_a = (self._load_w + self.power_w) / VOLTAGE_V
        follows = 1.0 if self._heat_lag_s == 0.0 else 1.0 - math.exp(-elapsed_s / self._heat_lag_s)
        self._arriving_w += follows * (HEATER_EFFICIENCY * self.power_w - self._arriving_w)
        heat_w = (RESISTANCE_OHM * self.current_a**2 + self._arriving_w
                  - LEAKAGE_W_PER_K * (self.temperature_c - self._ambient_c))
        self.temperature_c += heat_w * elapsed_s / self._heat_capacity_j_per_k
        self.soc -= self.current_a * elapsed_s / 3600.0 / 200.0
