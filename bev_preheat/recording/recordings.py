# SPDX-License-Identifier: Apache-2.0
"""Opens any recording: of the flight recorder, of `ros2 bag`, or a drive log with a route file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.control.settings import settings_of
from bev_preheat.errors import InvalidInput
from bev_preheat.files.configuration import version
from bev_preheat.files.input_files import mcap_messages
from bev_preheat.optional_packages import require
from bev_preheat.recording.bag_files import is_bag, SQLITE
from bev_preheat.recording.beginning import Beginning
from bev_preheat.recording.flight_file import read_flight
from bev_preheat.recording.log_recording import read_log
from bev_preheat.recording.topic_recording import read_topics
from bev_preheat.recording.writer import BEGINNING_CHANNEL
from bev_preheat.vehicle import vehicle_contents

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bev_preheat.recording.flight_file import Flight

# The recorder's first message is near the start of a file.
SEARCHED_RECORDS = 20


class Planner(NamedTuple):
    """The planner of a recording that does not hold it: vehicle file and parameters; None, {}: defaults."""

    vehicle: str | None = None
    parameters: Mapping[str, Any] = {}

    @property
    def is_given(self) -> bool:
        """Whether anything differs from the defaults."""
        return self.vehicle is not None or bool(self.parameters)


class Sources(NamedTuple):
    """The inputs beside a recording: route file and signal map of a log, namespace of a ros2 bag."""

    route: str | None = None
    signals: str | None = None
    namespace: str | None = None


def has_planner(path: Path) -> bool:
    """Return whether the flight recorder wrote a recording; raises InvalidInput if it cannot be read."""
    if path.is_dir():
        return not is_bag(path)
    if not path.is_file():
        raise InvalidInput(f'{path}: does not exist; name a recording or the folder of recordings')
    if not is_bag(path) or _is_sqlite(path):
        return False
    require('mcap')
    problems: list[str] = []
    for number, message in enumerate(mcap_messages(path, problems.append)):
        if message[0] == BEGINNING_CHANNEL:
            return True
        if number > SEARCHED_RECORDS:
            break
    return False


def _is_sqlite(path: Path) -> bool:
    with open(path, 'rb') as file:
        return file.read(len(SQLITE)) == SQLITE


def open_recording(path: Path, planner: Planner, sources: Sources) -> Flight:
    """
    Return the Flight of a recording; `planner` is needed for those that do not hold it.

    Raises InvalidInput, naming file or option, if it cannot be read or needs another option.
    """
    if has_planner(path):
        if sources != Sources():
            option = next(name for name, value in zip(Sources._fields, sources) if value is not None)
            raise InvalidInput(f'--{option}: a recording of the flight recorder has it already')
        return read_flight(path)
    is_topics = is_bag(path) and sources.signals is None
    if is_topics and sources.route is None:
        require('mcap')
        return read_topics(path, _beginning(planner), sources.namespace)
    if sources.namespace is not None:
        raise InvalidInput('--namespace: is for recordings of ros2 bag')
    if sources.route is None:
        raise InvalidInput(f'{path}: is no recording of the flight recorder or of ros2 bag; a log needs the route '
                           'beside it (--route)')
    return read_log(path, _beginning(planner), sources.route, sources.signals)


def _beginning(planner: Planner) -> Beginning:
    settings_of(planner.parameters)
    vehicle = planner.vehicle or 'reference'
    return Beginning(
        version(), '', '', 0, 0, False, {'vehicle': vehicle, **planner.parameters},
        vehicle_contents(vehicle).decode('utf-8', 'replace'))
