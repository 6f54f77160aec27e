# SPDX-License-Identifier: Apache-2.0
"""The first records of each file: version, parameters and vehicle file, and the planner's state."""

from __future__ import annotations

from base64 import b64decode, b64encode
from dataclasses import dataclass
from typing import Any, NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.control.state_bytes import state_bytes
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.estimation.prior import Lags, Learned

if TYPE_CHECKING:
    from bev_preheat.control.state import State

# Of the records of this version. Older ones are read as long as their numbers are listed in READ_FORMATS.
DRIVE_FORMAT = 2
READ_FORMATS = (2,)


@dataclass(frozen=True, eq=False)
class Beginning:
    """
    What replays need besides the planner's state.

    `life` identifies the planner's process, `part` counts its files from 0. `vehicle_file` is the text of the
    vehicle file and `parameters` has the node's parameters by name. `now_ns` is the node's clock [ns],
    `uses_sim_time` whether that is /clock.
    """

    version: str
    node: str
    life: str
    part: int
    now_ns: int
    uses_sim_time: bool
    parameters: dict[str, Any]
    vehicle_file: str

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        return {
            'format': DRIVE_FORMAT, 'version': self.version, 'node': self.node, 'life': self.life,
            'part': self.part, 'now_ns': self.now_ns, 'uses_sim_time': self.uses_sim_time,
            'parameters': self.parameters, 'vehicle_file': self.vehicle_file}

    @classmethod
    def from_dictionary(cls, values: Any) -> Beginning:
        """
        Return the Beginning of plain values.

        Raises InvalidInput if they are of another format, with its version, or damaged.
        """
        if not isinstance(values, dict) or values.get('format') not in READ_FORMATS:
            number, version = ((values.get('format'), values.get('version')) if isinstance(values, dict)
                               else (None, None))
            raise InvalidInput(
                f'the recording has format {quoted(str(number))} of version {quoted(str(version))}; this version '
                f'reads format {", ".join(map(str, READ_FORMATS))}; replay it with the version that wrote it')
        try:
            return cls(str(values['version']), str(values['node']), str(values['life']), int(values['part']),
                       int(values['now_ns']), bool(values['uses_sim_time']),
                       dict(values['parameters']), str(values['vehicle_file']))
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidInput(f"the recording's beginning is damaged: {type(error).__name__}: {error}") from error


class RecordedState(NamedTuple):
    """
    The planner's State after a step, as bytes (`control.state_bytes`).

    `goal` is the number of its preparation goal in the recording, None without one; `route_ns` [ns] is the instant
    at which the message of its route is recorded, None without a route.
    """

    state: bytes
    goal: int | None = None
    route_ns: int | None = None

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        return {'state': b64encode(self.state).decode(), 'goal': self.goal, 'route_ns': self.route_ns}

    @classmethod
    def from_dictionary(cls, values: dict[str, Any]) -> RecordedState:
        """Return the RecordedState of plain values; raises InvalidInput if they are damaged."""
        try:
            goal, route_ns = values['goal'], values['route_ns']
            return cls(b64decode(values['state']), None if goal is None else int(goal),
                       None if route_ns is None else int(route_ns))
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidInput(f'a state of the recording is damaged: {type(error).__name__}: {error}') from error


def recorded_state(state: State, goal: int | None = None, route_ns: int | None = None) -> RecordedState:
    """Return a State as a recording has it."""
    return RecordedState(state_bytes(state), goal, route_ns)


def learned_values(learned: Learned | None) -> dict[str, Any] | None:
    """Return a Learned as plain values; numbers keep every digit."""
    return None if learned is None else {
        'factors': learned.factors.tolist(), 'covariance': learned.covariance.tolist(),
        'lags': None if learned.lags is None else {
            'logs': learned.lags.logs.tolist(), 'variances': learned.lags.variances.tolist()}}


def learned_of(values: Any) -> Learned | None:
    """Return the Learned of plain values; raises KeyError, TypeError or ValueError if they are damaged."""
    if values is None:
        return None
    factors, covariance = np.array(values['factors'], dtype=float), np.array(values['covariance'], dtype=float)
    if covariance.shape != (len(factors), len(factors)) or not np.isfinite(covariance).all():
        raise ValueError('covariance does not fit the factors')
    lags = values['lags']
    return Learned(factors, covariance, None if lags is None else Lags(
        np.array(lags['logs'], dtype=float), np.array(lags['variances'], dtype=float)))
