# SPDX-License-Identifier: Apache-2.0
"""The part of a recording that is shown and compared; the planner is played from the recording's start."""

from __future__ import annotations

from datetime import datetime, time, UTC
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.numerics.factors import NS_PER_DAY, NS_PER_S
from bev_preheat.planning.explanation import duration_text

if TYPE_CHECKING:
    from bev_preheat.recording.flight_file import Flight

# Longer pauses between two steps are no drive [ns].
LONGEST_PAUSE_NS = 60 * NS_PER_S


class Period(NamedTuple):
    """From an instant to another [ns], both included."""

    from_ns: int = -2**63
    to_ns: int = 2**63

    def has(self, now_ns: int) -> bool:
        """Return whether an instant [ns] lies within it."""
        return self.from_ns <= now_ns <= self.to_ns


WHOLE = Period()


def instant_of(option: str, text: str, start_ns: int) -> int:
    """
    Return the instant [ns] of seconds from the start or of a time of day (UTC).

    Raises InvalidInput, naming the option, for anything else.
    """
    try:
        if ':' not in text:
            return start_ns + round(float(text) * NS_PER_S)
        start = datetime.fromtimestamp(start_ns / NS_PER_S, UTC)
        at = datetime.combine(start.date(), time.fromisoformat(text), UTC)
        # A recording may go past midnight.
        at_ns = round(at.timestamp() * NS_PER_S)
        return at_ns if at_ns >= start_ns - NS_PER_S else at_ns + NS_PER_DAY
    except (ValueError, OverflowError) as error:
        raise InvalidInput(f'{option}: {quoted(text)} is not allowed; it must be seconds from the start of the '
                           'recording, or HH:MM:SS') from error


def period_of(flight: Flight, begin: str | None, end: str | None) -> Period:
    """Return the Period from `begin` to `end` (None: open); raises InvalidInput if it has no step."""
    instants = [given.step.now_ns for given in flight.given]
    start_ns = flight.start_ns
    period = Period(WHOLE.from_ns if begin is None else instant_of('--from', begin, start_ns),
                    WHOLE.to_ns if end is None else instant_of('--to', end, start_ns))
    if period.from_ns > period.to_ns:
        raise InvalidInput(f'--to: {quoted(str(end))} is before --from, {quoted(str(begin))}')
    if not any(period.has(now_ns) for now_ns in instants):
        option = '--to' if period.to_ns < min(instants) else '--from'
        raise InvalidInput(f'{option}: the recording has no step there; it is '
                           f'{duration_text((max(instants) - start_ns) / NS_PER_S)} long, from '
                           f'{moment(start_ns)} on')
    return period


def driven_ns(flight: Flight, period: Period = WHOLE) -> int:
    """Return how long [ns] the steps of a Period take, without pauses and jumps of the clock."""
    instants = [given.step.now_ns for given in flight.given if period.has(given.step.now_ns)]
    return sum(min(max(after - before, 0), LONGEST_PAUSE_NS) for before, after in zip(instants, instants[1:]))


def moment(now_ns: int) -> str:
    """Return an instant [ns] in words."""
    return datetime.fromtimestamp(now_ns / NS_PER_S, UTC).strftime('%Y-%m-%d %H:%M:%S UTC')
