# SPDX-License-Identifier: Apache-2.0
"""RankChargers: candidates out of a request, and the ranking into its response."""

from __future__ import annotations

from collections import Counter
import math
from typing import TYPE_CHECKING

from bev_preheat.charging.chargers import Candidate, END_S, ranking_verdict
from bev_preheat.charging.stop import CHARGER_RANGE_W
from bev_preheat.charging.target_worth import MOST_PRICE_PER_KWH
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.messages.fields import Figure
from bev_preheat.route.segments import Places, Route

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.charging.chargers import CandidateWorth
    from bev_preheat_msgs.srv import RankChargers

MOST_CHARGERS = 20
LONGEST_ASIDE_S = 14400.0
# Arrays of the request that may be empty, and the default of an element.
OPTIONAL = {'energy_price': (Figure(0.0, MOST_PRICE_PER_KWH, 'per kWh', nan="the node's"), math.nan),
            'detour': (Figure(0.0, LONGEST_ASIDE_S, 's'), 0.0),
            'expected_wait': (Figure(0.0, LONGEST_ASIDE_S, 's'), 0.0)}
# Fields of the response, NaN for a charger without a worth.
FIGURES = ('best_battery_temperature', 'unheated_battery_temperature', 'arrival_soc', 'charging_departure_soc',
           'charging_time', 'bought_energy', 'energy_cost', 'time_cost', 'total_cost')


def candidates_of(request: RankChargers.Request, ahead: Route, driven_m: float,
                  energy_price_per_kwh: float) -> list[Candidate]:
    """
    Return the Candidates of a request along the Route ahead, which begins `driven_m` [m] from its start.

    `energy_price_per_kwh` applies to those without a price. Raises InvalidInput, one problem per wrong field, with
    field, value and allowed range.
    """
    count = len(request.name)
    problems = [] if 1 <= count <= MOST_CHARGERS else [
        f'name: has {count} elements; it must have 1 ... {MOST_CHARGERS}']
    problems += [f'name: {quoted(name)} stands {often} times' for name, often in Counter(
        request.name).items() if often > 1]
    problems += [f'name[{at}]: must not be empty' for at, name in enumerate(request.name) if not name]
    fields = {'distance': (Figure(driven_m, driven_m + ahead.distance_m, 'm, on the rest of the route'), None),
              'charger_power': (Figure(*CHARGER_RANGE_W, 'W'), None), **OPTIONAL}
    columns = [_column(request, field, allowed, problems, default) for field, (allowed, default) in fields.items()]
    if problems:
        raise InvalidInput(problems)
    places = Places.of_route(ahead)
    candidates = []
    for name, distance_m, power_w, price_per_kwh, detour_s, wait_s in zip(request.name, *columns):
        instant_s = max(places.earliest_s(distance_m - driven_m), END_S)
        if instant_s > ahead.total_duration_s - END_S:
            instant_s = ahead.total_duration_s
        candidates.append(Candidate(
            name, instant_s, power_w, energy_price_per_kwh if math.isnan(price_per_kwh) else price_per_kwh,
            detour_s, wait_s))
    return candidates


def _column(request: RankChargers.Request, field: str, allowed: Figure,
            problems: list[str], default: float | None) -> Sequence[float]:
    """Return the values of a field, one for each name; `default` fills an empty one, None: it is needed."""
    values, count = list(getattr(request, field)), len(request.name)
    if default is not None and not values:
        return [default] * count
    if len(values) != count:
        empty = '' if default is None else ', or be empty'
        problems.append(f'{field}: has {len(values)} elements; it must have {count}, as name has{empty}')
        return values
    problems += filter(None, (allowed.problem(f'{field}[{at}]', value) for at, value in enumerate(values)))
    return values


def write_ranking(response: RankChargers.Response, ranked: Sequence[CandidateWorth]) -> None:
    """Write ranked CandidateWorths into a response."""
    response.success, response.message = True, ranking_verdict(ranked)
    response.ranked_name = [item.candidate.name for item in ranked]
    response.problem = [item.problem or '' for item in ranked]
    for field, values in zip(FIGURES, zip(*map(_figures, ranked)), strict=True):
        setattr(response, field, list(values))


def _figures(item: CandidateWorth) -> tuple[float, ...]:
    worth = item.worth if item.problem is None else None
    best = None if worth is None else worth.best
    if worth is None or best is None:
        return (math.nan,) * len(FIGURES)
    return (best.arrival_temperature_c, worth.without_heating.arrival_temperature_c, best.arrival_soc,
            item.departure_soc, best.charging_time_s, best.bought_energy_wh, item.energy_cost,
            item.charging_cost + item.detour_cost + item.wait_cost, item.total_cost)
