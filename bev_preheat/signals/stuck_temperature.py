# SPDX-License-Identifier: Apache-2.0
"""
Detects a temperature reading that does not follow the battery.

The model's expected change is integrated since the reading last moved. The heater's heat counts only as
far as its power was measured, because a heater that takes no power explains a cold battery.
"""

from __future__ import annotations

from collections import deque

# Expected change without any movement of the reading that proves a fault [K]; a step of the sensor comes on
# top. Fast changes need more, because heater and sensor lag: LAGS_S [s] of the change, plus BESIDE_LAGS_K.
EXPECTED_K = 3.0
LAGS_S, BESIDE_LAGS_K = 120.0, 1.5
# The change is integrated over at most this time [s]: a slower one may be an error of the model.
WITHIN_S = 900.0
# A reading that has moved by less than this [K] has not moved.
MOVED_K = 0.05
# States further apart than this [s] are not followed.
TOGETHER_S = 60.0
# A battery is not colder than ambient by more than this [K]: no vehicle cools it below that.
BELOW_AMBIENT_K = 20.0


class StuckTemperature:
    """Watches the temperature; `doubt` is the sentence, '' while the reading follows the battery."""

    def __init__(self) -> None:
        """Start without readings."""
        self.doubt = ''
        self._reading_c: float | None = None
        self._since_s = self._latest_s = 0.0
        # (instant [s], change expected until then [K]) since the reading moved.
        self._expected: deque[tuple[float, float]] = deque()
        self._has_ever_moved = False

    def lose_time(self) -> None:
        """Start again at the next reading, because time was lost."""
        self._reading_c = None
        self._expected.clear()

    def see(self, instant_s: float, reading_c: float, step_k: float, rate_k_per_s: float,
            ambient_c: float | None) -> str:
        """
        Update with a reading; return `doubt`.

        Instant [s], reading and ambient temperature [deg C] (None: unknown), step of the sensor [K],
        rate at which the model expects the temperature to change [K/s].
        """
        if ambient_c is not None and reading_c < ambient_c - BELOW_AMBIENT_K:
            self.doubt = (f'temperature: {reading_c:.1f} degC is {ambient_c - reading_c:.1f} K below the ambient '
                          f'temperature of {ambient_c:.1f} degC; at most {BELOW_AMBIENT_K:g} K are possible; '
                          'the field may not be set')
            self._begin(instant_s, reading_c)
            return self.doubt
        before_c, elapsed_s = self._reading_c, instant_s - self._latest_s
        self._latest_s = instant_s
        if before_c is None or abs(reading_c - before_c) > MOVED_K or not 0.0 <= elapsed_s <= TOGETHER_S:
            self._has_ever_moved = self._has_ever_moved or (
                before_c is not None and abs(reading_c - before_c) > MOVED_K)
            if before_c is None or abs(reading_c - before_c) > MOVED_K:
                self.doubt = ''
            self._begin(instant_s, reading_c)
            return self.doubt
        expected = self._expected
        expected.append((instant_s, expected[-1][1] + rate_k_per_s * elapsed_s))
        while expected[0][0] < instant_s - WITHIN_S:
            expected.popleft()
        change_k = expected[-1][1] - expected[0][1]
        elapsed_s = expected[-1][0] - expected[0][0]
        held_back_k = BESIDE_LAGS_K + (LAGS_S * abs(change_k) / elapsed_s if elapsed_s > 0.0 else 0.0)
        if abs(change_k) > max(EXPECTED_K, held_back_k) + step_k:
            still = f'for {instant_s - self._since_s:.0f} s' if self._has_ever_moved else 'since the first state'
            direction = 'warmed' if change_k > 0.0 else 'cooled'
            self.doubt = (f'temperature: has read {reading_c:.2f} degC {still}, while the battery must have '
                          f'{direction} by {abs(change_k):.1f} K; the field may not be set')
        return self.doubt

    def _begin(self, instant_s: float, reading_c: float) -> None:
        """Expect changes from this reading on."""
        self._reading_c, self._since_s, self._latest_s = reading_c, instant_s, instant_s
        self._expected.clear()
        self._expected.append((instant_s, 0.0))
