# SPDX-License-Identifier: Apache-2.0
"""The verdict on a signal: in doubt, why, and since when."""

from __future__ import annotations

from dataclasses import dataclass
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


class _Doubt(NamedTuple):
    """A verdict, and the instant until which it is shown [ns]; None: until its signal holds."""

    verdict: SignalVerdict
    shown_until_ns: int | None = None


@dataclass(frozen=True)
class Doubts:
    """The doubts about signals, one each."""

    held: tuple[_Doubt, ...] = ()

    @property
    def verdicts(self) -> tuple[SignalVerdict, ...]:
        """The SignalVerdicts; () while every signal holds."""
        return tuple([doubt.verdict for doubt in self.held])

    @property
    def needed(self) -> tuple[SignalVerdict, ...]:
        """The SignalVerdicts on signals without which nothing is heated."""
        return tuple([doubt.verdict for doubt in self.held if doubt.verdict.signal in NEEDED])

    def __contains__(self, signal: str) -> bool:
        """Return whether a signal is in doubt."""
        return any(doubt.verdict.signal == signal for doubt in self.held)

    def noted(self, signal: str, sentence: str, now_ns: int, shown_until_ns: int | None = None) -> Doubts:
        """Return the Doubts with the sentence on a signal at an instant [ns]; '' ends its doubt."""
        before = next((doubt for doubt in self.held if doubt.verdict.signal == signal), None)
        if not sentence:
            return self if before is None else Doubts(tuple([doubt for doubt in self.held if doubt is not before]))
        since_ns = now_ns if before is None else before.verdict.since_ns
        noted = _Doubt(SignalVerdict(signal, sentence, since_ns), shown_until_ns)
        return Doubts((*self.held, noted) if before is None else tuple([
            noted if doubt is before else doubt for doubt in self.held]))

    def at(self, now_ns: int) -> Doubts:
        """Return the Doubts without those that were shown until an instant [ns]."""
        return Doubts(tuple([doubt for doubt in self.held if doubt.shown_until_ns is None
                             or now_ns < doubt.shown_until_ns])) if self.held else self

    def without_instants(self) -> Doubts:
        """Return the Doubts none of which is shown for longer."""
        return Doubts(tuple([doubt if doubt.shown_until_ns is None else doubt._replace(shown_until_ns=0)
                             for doubt in self.held]))
