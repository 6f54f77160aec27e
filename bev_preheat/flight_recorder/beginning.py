# SPDX-License-Identifier: Apache-2.0
"""The first record of each file: version, parameters, vehicle file, and the learned values at its start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.estimation.driver_choices import choices_entry, choices_from, NO_CHOICES
from bev_preheat.estimation.last_seen import last_seen_entry, last_seen_from
from bev_preheat.estimation.prior import Lags, Learned

if TYPE_CHECKING:
    from bev_preheat.estimation.driver_choices import DriverChoices
    from bev_preheat.estimation.last_seen import LastSeen

# Of the records of this version. Older ones are read as long as their numbers are listed in READ_FORMATS.
FORMAT = 1
READ_FORMATS = (1,)


@dataclass(frozen=True, eq=False)
class Beginning:
    """
    The planner's knowledge at the start of a file, which replays start from.

    `life` identifies the planner's process, `part` counts its files from 0. `is_whole`: no step came before it,
    so that a replay knows all that the planner knew. `vehicle_file` is the text of the vehicle file and
    `parameters` has the node's parameters by name. `learned` None: nothing. `now_ns` is the node's clock [ns],
    `uses_sim_time` whether that is /clock.
    """

    version: str
    node: str
    life: str
    part: int
    is_whole: bool
    now_ns: int
    uses_sim_time: bool
    parameters: dict[str, Any]
    vehicle_file: str
    learned: Learned | None = None
    last_seen: LastSeen | None = None
    choices: DriverChoices = NO_CHOICES

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        return {
            'format': FORMAT, 'version': self.version, 'node': self.node, 'life': self.life, 'part': self.part,
            'is_whole': self.is_whole, 'now_ns': self.now_ns, 'uses_sim_time': self.uses_sim_time,
            'parameters': self.parameters,
            'vehicle_file': self.vehicle_file, 'learned': learned_values(self.learned),
            'last_seen': None if self.last_seen is None else last_seen_entry(self.last_seen),
            'choices': choices_entry(self.choices)}

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
                       bool(values['is_whole']), int(values['now_ns']), bool(values['uses_sim_time']),
                       dict(values['parameters']), str(values['vehicle_file']), learned_of(values['learned']),
                       None if values['last_seen'] is None else last_seen_from(values['last_seen']),
                       choices_from(values['choices']))
        except InvalidInput:
            raise
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidInput(f"the recording's beginning is damaged: {type(error).__name__}: {error}") from error


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
