# SPDX-License-Identifier: Apache-2.0
"""The view of a planner at an instant: the one value that the web page and the terminal lay out, also as JSON."""

from __future__ import annotations

from dataclasses import dataclass, field
import json
import math
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.errors import shortened
from bev_preheat.planning.status import Status

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bev_preheat.monitoring.seen import Diagnosis, PlanSeen

# A message is late after this time [s of real time], or after LATE_INTERVALS of its usual intervals.
LATE_S, LATE_INTERVALS, LONGEST_LATE_S = 3.0, 4.0, 40.0
# The battery state stands, though the planner answers.
FROZEN_S = 4.0
# Weight of the latest interval in the usual one.
INTERVAL_WEIGHT = 0.2


class Surroundings(NamedTuple):
    """Whether a planner is there, whether it follows /clock, and whether /clock has a publisher."""

    is_there: bool = True
    is_simulated: bool = False
    has_clock: bool = False


class Banner(NamedTuple):
    """A sentence at the top of the page, its level (`error`, `warning`), and the word in the list of planners."""

    level: str
    text: str
    word: str


@dataclass
class Pulse:
    """When the messages of a topic came [s, monotonic], and how far apart they usually are [s]."""

    came_s: float | None = None
    usual_s: float = 1.0
    _stamp_s: float | None = field(default=None, repr=False)
    # Since when the stamps have not advanced.
    stands_since_s: float | None = None

    def beat(self, now_s: float, stamp_s: float) -> None:
        """Note a message with a stamp [s of the planner's clock]."""
        if self.came_s is not None:
            self.usual_s += INTERVAL_WEIGHT * (min(now_s - self.came_s, LONGEST_LATE_S) - self.usual_s)
        if stamp_s != self._stamp_s:
            self.stands_since_s = None
        elif self.stands_since_s is None:
            self.stands_since_s = self.came_s
        self.came_s, self._stamp_s = now_s, stamp_s

    def age_s(self, now_s: float) -> float | None:
        """Return the age of the latest message [s]; None before the first."""
        return None if self.came_s is None else max(0.0, now_s - self.came_s)

    def is_late(self, now_s: float) -> bool:
        """Return whether the next message is overdue."""
        age_s = self.age_s(now_s)
        return age_s is not None and age_s > min(max(LATE_S, LATE_INTERVALS * self.usual_s), LONGEST_LATE_S)

    def stands_s(self, now_s: float) -> float:
        """Return for how long the stamps have not advanced although messages come [s]."""
        return 0.0 if self.stands_since_s is None else now_s - self.stands_since_s


def banner_of(around: Surroundings, command: Pulse, battery: Pulse, now_s: float) -> Banner | None:
    """Return the Banner on a missing, silent or frozen planner; None if all is well."""
    age_s = command.age_s(now_s)
    if not around.is_there:
        return Banner('error', 'The planner has disappeared. Its heater command has expired, so the heater is '
                      'off. The values below are its last ones.'
                      if age_s is not None else 'The planner has disappeared.', 'gone')
    if age_s is None:
        return Banner('warning', 'The planner is there; its first message has not arrived yet.', 'no message yet')
    if command.is_late(now_s):
        if around.is_simulated and not around.has_clock:
            return Banner('error', f'The clock stands: nothing publishes /clock. No message for {age_s:.0f} s.',
                          'its clock stands')
        if around.is_simulated:
            return Banner('error', f'The clock stands: /clock does not advance. No message for {age_s:.0f} s.',
                          'its clock stands')
        return Banner('error', f'The planner is silent: no message for {age_s:.0f} s. Without fresh commands the '
                      'heater is off.', 'silent')
    if command.stands_s(now_s) > FROZEN_S:
        return Banner('error', f"The planner's clock has been standing for {command.stands_s(now_s):.0f} s.",
                      'its clock stands')
    if battery.is_late(now_s):
        return Banner('warning', f'No battery state for {battery.age_s(now_s):.0f} s: the measured '
                      'values are old.', 'no battery state')
    if battery.stands_s(now_s) > FROZEN_S:
        return Banner('warning', 'The battery state repeats one stamp: the measured values are old.',
                      'the battery state stands')
    return None


# Values beyond this are no measurement of a car, and no scale of a chart fits them.
MOST_VALUE = 1e9
LONGEST_SENTENCE = 2000


def number(value: float | None, digits: int = 3) -> float | None:
    """Return a number rounded for display; None if it is unknown, infinite or beyond MOST_VALUE."""
    if value is None or not math.isfinite(value) or abs(value) > MOST_VALUE:
        return None
    return round(value, digits)


def instant(value: float | None) -> float | None:
    """Return an instant [s] in milliseconds' resolution; None if it is unknown or unset."""
    return None if value is None or not math.isfinite(value) or value <= 0.0 else round(value, 3)


def instants(values: Sequence[float]) -> list[float | None]:
    """Return the instants of a column [s]."""
    return [instant(value) for value in values]


def numbers(values: Sequence[float], digits: int = 3) -> list[float | None]:
    """Return the numbers of a column."""
    return [number(value, digits) for value in values]


def written(value: Any) -> str:
    """Return a value as JSON, without characters that end a script element."""
    return json.dumps(value, separators=(',', ':'), allow_nan=False).replace('<', '\\u003c')


@dataclass(frozen=True)
class View:
    """
    Plain values: instants in s of the planner's clock, temperatures in deg C, powers in W, charge 0 ... 1.

    None and NaN stand for unknown. `ages_s` [s of real time] are those of the latest messages by topic, `late` are
    the overdue topics. `until_s` is the end of the command's lease, `reserve` the charge asked for on arrival;
    `outcome` says how the latest goal ended,
    `sources_w` the commands to all heat sources by name, {} for the HVCH alone.
    """

    at_s: float | None
    banner: Banner | None
    ages_s: dict[str, float | None]
    late: list[str]
    temperature_c: float
    soc: float
    power_w: float
    delivered_w: float
    until_s: float
    reason: int | None
    plan: PlanSeen | None
    reserve: float | None
    trip_from_s: float | None
    diagnosis: Diagnosis
    unheated_problem: str = ''
    outcome: str = ''
    sources_w: Mapping[str, float] = field(default_factory=dict)

    @property
    def sentence(self) -> str:
        """The plan's sentence, '' without one."""
        return '' if self.plan is None else shortened(self.plan.sentence, LONGEST_SENTENCE)

    def as_dictionary(self) -> dict[str, Any]:
        """Return plain values for the page's JSON, rounded as they are shown."""
        return {
            'at': instant(self.at_s), 'banner': None if self.banner is None else self.banner._asdict(),
            'ages': {topic: number(age_s, 1) for topic, age_s in self.ages_s.items()}, 'late': self.late,
            'temperature': number(self.temperature_c, 2), 'soc': number(self.soc, 4),
            'power': number(self.power_w, 1), 'delivered': number(self.delivered_w, 1),
            'sources': [[name, number(power_w, 1)] for name, power_w in self.sources_w.items()],
            'reason': None if self.reason is None else status_name(self.reason),
            **self._plan_values(), 'reserve': number(self.reserve, 4), 'unheatedProblem': self.unheated_problem,
            'outcome': shortened(self.outcome, LONGEST_SENTENCE), 'tripFrom': instant(self.trip_from_s),
            **self.diagnosis.as_dictionary()}

    def _plan_values(self) -> dict[str, Any]:
        plan = self.plan
        if plan is None:
            return {'status': None, 'sentence': '', 'routeId': '', 'method': ''}
        return {
            'status': status_name(plan.status), 'sentence': self.sentence,
            'routeId': shortened(plan.route_id, 256), 'method': shortened(plan.method, 60),
            'heatingStart': instant(plan.heating_start_s), 'heatingEnd': instant(plan.heating_end_s),
            'arrival': instant(plan.arrival_s), 'predicted': number(plan.predicted_c, 2),
            'deviation': number(plan.deviation_k, 2), 'target': number(plan.target_c, 2),
            'targetReason': shortened(plan.target_reason, LONGEST_SENTENCE),
            'arrivalSoc': number(plan.arrival_soc, 4),
            'charging': number(plan.charging_s, 0), 'chargingUnheated': number(plan.charging_unheated_s, 0)}


def status_name(number: int) -> str:
    """Return the name of a status."""
    try:
        return Status(number).name
    except ValueError:
        return f'STATUS_{number}'
