# SPDX-License-Identifier: Apache-2.0
"""The likely cause of a command that a replay does not give again."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.files.configuration import version
from bev_preheat.native.library import core
from bev_preheat.planning.planner import METHODS
from bev_preheat.recording.flight_file import FLIGHT_RECORDER

if TYPE_CHECKING:
    from bev_preheat.recording.comparison import Difference
    from bev_preheat.recording.flight_file import Flight


def cause_of(flight: Flight, first: Difference) -> str:
    """Return the likely cause of the first Difference, as a sentence."""
    beginning, parameters = flight.beginning, flight.beginning.parameters
    if flight.source != FLIGHT_RECORDER:
        return ('The recording has no vehicle file, parameters and learned factors: compare those of the recorded '
                'planner with --vehicle, --method and --set.')
    if any(gap <= first.number and not any(gap <= start.at <= first.number for start in flight.starts)
           for gap in flight.gaps):
        return 'Steps before it were not recorded, so the replayed planner knows less.'
    if beginning.version != version():
        return f'Version {beginning.version} recorded it, and version {version()} replays it.'
    method = str(parameters.get('method', ''))
    if method and method not in METHODS:
        return f'The method {method} comes from an installed package, and may depend on more than its inputs.'
    if parameters.get('compiled_core', True) and core() is None:
        return 'The native core is not built here, and the recorded planner may have used it.'
    return ('None is known: version, parameters, vehicle file and inputs are the recorded ones. The file may '
            'have been changed, or the computer computes otherwise.')
