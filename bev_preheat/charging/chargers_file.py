# SPDX-License-Identifier: Apache-2.0
"""Chargers along a route as a YAML file (see chargers_schema.yaml)."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.charging.candidates import Candidate
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.checked_yaml import FileData, load_checked_yaml
from bev_preheat.files.configuration import find_configuration
from bev_preheat.numerics.factors import S_PER_MIN
from bev_preheat.route.places import Places

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.route.segments import Route

SCHEMA = Path(__file__).with_name('chargers_schema.yaml')
M_PER_KM = 1000.0
# A place this close to the route's end [s] counts as its end: figures in files are rounded.
END_S = 1.0


@dataclass(frozen=True)
class Chargers:
    """The Candidates of a file, and its path."""

    candidates: tuple[Candidate, ...]
    file: Path


def load_chargers(name_or_file: str | Path, route: Route, energy_price_per_kwh: float,
                  only: Sequence[str] = ()) -> Chargers:
    """
    Return the Chargers of a name (a file in config/chargers) or of a YAML file, along a Route.

    `energy_price_per_kwh` is the default price; with `only` (names), all other chargers are left out. Raises
    InvalidInput naming file, key, value and the allowed values.
    """
    path = find_configuration('chargers', name_or_file, '.yaml')
    nodes: list[FileData] = load_checked_yaml(path, SCHEMA)['chargers']
    names = [node['name'] for node in nodes]
    problems = [f'{path}: chargers: duplicate name {quoted(name)} ({count} times)'
                for name, count in Counter(names).items() if count > 1]
    candidates = []
    for index, node in enumerate(nodes):
        wrong = _problems(node, route)
        problems += [f'{path}: chargers[{index}] ({node["name"]}){problem}' for problem in wrong]
        if not wrong:
            candidates.append(_candidate(node, route, energy_price_per_kwh))
    problems += [f'--only: charger {quoted(name)} is unknown; {path} has: {", ".join(names)}'
                 for name in only if name not in names]
    if problems:
        raise InvalidInput(problems)
    return Chargers(tuple(candidate for candidate in candidates
                          if not only or candidate.name in only), path)


def _problems(node: FileData, route: Route) -> list[str]:
    """Return the problems of one charger that passed the schema."""
    problems = []
    if ('at_km' in node) == ('at_min' in node):
        problems.append(': needs either at_km or at_min')
    for key, most, unit in (('at_km', route.distance_m / M_PER_KM, 'km'),
                            ('at_min', route.total_duration_s / S_PER_MIN, 'min')):
        if key in node and node[key] > most + END_S / S_PER_MIN:
            problems.append(f'.{key}: {node[key]:g} is beyond the route, which ends at {most:.1f} {unit}')
    if ('free_probability' in node) != ('wait_min' in node):
        problems.append(': free_probability and wait_min must be given together')
    return problems


def _candidate(node: FileData, route: Route, energy_price_per_kwh: float) -> Candidate:
    if 'at_min' in node:
        instant_s = node['at_min'] * S_PER_MIN
    else:
        places = Places.of_route(route)
        # While the vehicle stands, one distance has many instants; the first one counts.
        distance_m, first = np.unique(places.distance_m, return_index=True)
        instant_s = float(np.interp(node['at_km'] * M_PER_KM, distance_m, places.time_s[first]))
    if instant_s > route.total_duration_s - END_S:
        instant_s = route.total_duration_s
    return Candidate(
        node['name'], instant_s, float(node['charger_power_w']),
        float(node.get('energy_price_per_kwh', energy_price_per_kwh)),
        node.get('detour_min', 0.0) * S_PER_MIN,
        (1.0 - node.get('free_probability', 1.0)) * node.get('wait_min', 0.0) * S_PER_MIN,
        float(node.get('free_probability', 1.0)))
