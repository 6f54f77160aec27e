# SPDX-License-Identifier: Apache-2.0
"""The view of a planner at an instant: the one value that the web page and the terminal lay out, also as JSON."""

from __future__ import annotations

from dataclasses import dataclass
import json
import math
from typing import Any, TYPE_CHECKING

from bev_preheat.errors import shortened
from bev_preheat.planning.status import Status

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.monitoring.health import Banner
    from bev_preheat.monitoring.seen import Diagnosis, PlanSeen

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
    `outcome` says how the latest goal ended.
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
