# SPDX-License-Identifier: Apache-2.0
"""The verdict on a signal: in doubt, why, and since when."""

from __future__ import annotations

from typing import NamedTuple

TEMPERATURE = 'battery_temperature'
STATE_OF_CHARGE = 'state_of_charge'
VOLTAGE = 'voltage'
CURRENT = 'current'
# Which battery the messages come from.
SOURCE = 'source'
# How often they arrive.
FEED = 'feed'
SIGNALS = (TEMPERATURE, STATE_OF_CHARGE, VOLTAGE, CURRENT, SOURCE, FEED)
# Without these the heater is off; voltage and current count as not sent.
NEEDED = frozenset((TEMPERATURE, STATE_OF_CHARGE, SOURCE, FEED))


class SignalVerdict(NamedTuple):
    """A signal in doubt (see SIGNALS), the evidence in a sentence, and since when [ns]."""

    signal: str
    sentence: str
    since_ns: int
