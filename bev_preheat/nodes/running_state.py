# SPDX-License-Identifier: Apache-2.0
"""
The planner's whole State beside its state file, from which a restarted planner goes on.

It is used only if nothing that it depends on has changed: the vehicle file, the parameters, the state file, and a
clock that has gone on. Otherwise the planner begins with the state file alone.
"""

from __future__ import annotations

from base64 import b64decode, b64encode
from hashlib import sha256
import json
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.preparation import Preparation
from bev_preheat.control.state_bytes import state_bytes, state_of
from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import existing_file, expanded, write_whole
from bev_preheat.tunables import OLDEST_CHOICE_NS

if TYPE_CHECKING:
    from bev_preheat.control.settings import Settings
    from bev_preheat.control.state import State

SUFFIX = '.running'
KEY, FORMAT = 'bev_preheat_running_state', 1
OWN_HEAD = b'{"%s":' % KEY.encode()
LARGEST_FILE_BYTES = 100_000_000


class Running(NamedTuple):
    """A State, and the message of its route as bytes (CDR); None without a route."""

    state: State
    route: bytes | None


def save_running(path: str, fingerprint: str, running: Running) -> None:
    """
    Write a Running beside the state file of a path, for the vehicle file with this fingerprint.

    Raises InvalidInput if that file is another one, or cannot be written.
    """
    beside = path + SUFFIX
    before = _contents(beside, len(OWN_HEAD))
    if before and not before.startswith(OWN_HEAD):
        raise InvalidInput(f'{beside}: not overwritten: it is not the state of a running planner; name another '
                           'state file')
    route = running.route
    write_whole(beside, json.dumps({
        KEY: FORMAT, 'vehicle_file_sha256': fingerprint, 'state_file_sha256': _hash_of(path),
        'route': None if route is None else b64encode(route).decode(),
        'state': b64encode(state_bytes(running.state)).decode()}, separators=(',', ':')),
        make_folder=True, outlasts_power=False)


def load_running(path: str, fingerprint: str, settings: Settings, now_ns: int) -> Running | None:
    """
    Return the Running beside the state file of a path as it holds at an instant [ns]; None: it does not hold.

    A preparation goal has ended with the process that it was given to. Raises InvalidInput if the file is damaged,
    or of another version.
    """
    contents = _contents(path + SUFFIX)
    if not contents:
        return None
    try:
        values = json.loads(contents)
        if values[KEY] != FORMAT:
            raise InvalidInput(f'{path}{SUFFIX}: has format {values[KEY]}; this version reads {FORMAT}')
        is_of_this = (values['vehicle_file_sha256'], values['state_file_sha256']) == (fingerprint, _hash_of(path))
        route = None if values['route'] is None else b64decode(values['route'])
        state = state_of(b64decode(values['state'])) if is_of_this else None
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidInput(f'{path}{SUFFIX}: is damaged: {type(error).__name__}: {error}') from error
    if state is None or state.settings != settings or not 0 <= now_ns - state.now_ns <= OLDEST_CHOICE_NS:
        return None
    return Running(_as_after_restart(state, now_ns), route)


def _as_after_restart(state: State, now_ns: int) -> State:
    """
    Return a State without the goals, other nodes and publications of the process before.

    The publisher of a cancelled route may still latch it, and sends it to the new process. A heater whose lease
    has ended has been off since.
    """
    preparation, choices = state.preparation, state.inbox.choices.after_restart(now_ns)
    inbox = state.inbox._replace(rivals='', choices=choices, cancelled_before=choices.cancelled_trip)
    if preparation.goal is not None:
        inbox = inbox.with_other_goal()
    command, commander, answers = state.latest_command, state.commander, state.answers
    if command is not None and command.valid_until_ns <= now_ns:
        off_ns = command.valid_until_ns
        commander = commander.free_to_switch()._replace(
            switch=commander.switch.forced_off(), history=commander.history.noted(off_ns, 0.0), reason=None)
        answers = answers._replace(history=answers.history.noted(off_ns, 0.0))
    return state._replace(
        commander=commander, answers=answers, inbox=inbox, inactive='', published_status=None,
        preparation=Preparation(memory=preparation.memory, ambient=preparation.ambient))


def _contents(path: str, most_bytes: int = LARGEST_FILE_BYTES) -> bytes:
    """Return the first bytes of a file; b'' without a file."""
    if existing_file(path) is None:
        return b''
    try:
        with open(expanded(path), 'rb') as file:
            return file.read(most_bytes)
    except OSError as error:
        raise InvalidInput(f'{path}: cannot be read: {error.strerror}') from error


def _hash_of(path: str) -> str:
    return sha256(_contents(path)).hexdigest()
