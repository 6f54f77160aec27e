# SPDX-License-Identifier: Apache-2.0
"""
Stores knowledge of the car, and the driver's choices, across restarts of the planner's process.

The planner's whole State lies beside its state file. A restarted planner goes on from it only if nothing that it
depends on has changed: the vehicle file, the parameters, the state file, and a clock that has gone on. Otherwise
the planner begins with the state file alone.
"""

from __future__ import annotations

from base64 import b64decode, b64encode
from collections.abc import Callable
from hashlib import sha256
import json
import time
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.impl.rcutils_logger import RcutilsLogger

from bev_preheat.control.inputs import Mission
from bev_preheat.control.preparation import Preparation
from bev_preheat.control.settings import Settings
from bev_preheat.control.state import State
from bev_preheat.control.state_bytes import state_bytes, state_of
from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.before_restart import DriverChoices, LastSeen, NO_CHOICES
from bev_preheat.estimation.estimate import Estimate
from bev_preheat.estimation.state_file import check_state_file, learned_from, load_state, Recalled, save_state
from bev_preheat.files.output_files import check_writable, existing_file, expanded, write_whole
from bev_preheat.messages.diagnostics import entry, ERROR, OK, WARN
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.status import Status
from bev_preheat.tunables import OLDEST_CHOICE_NS
from bev_preheat.vehicle import vehicle_fingerprint

SUFFIX = '.running'
KEY, FORMAT = 'bev_preheat_running_state', 1
OWN_HEAD = b'{"%s":' % KEY.encode()
LARGEST_FILE_BYTES = 100_000_000


def _as_after_restart(state: State, now_ns: int) -> State:
    """
    Return a State without the goals, other nodes and publications of the process before.

    A preparation goal has ended with the process that it was given to. The publisher of a cancelled route may
    still latch it, and sends it to the new process. A heater whose lease has ended has been off since.
    """
    preparation, choices = state.preparation, state.inbox.choices.after_restart(now_ns)
    inbox = state.inbox._replace(rivals='', choices=choices, cancelled_before=choices.cancelled_trip)
    if preparation.goal is not None:
        inbox = inbox.with_other_goal()
    command, commander, answers = state.latest_command, state.commander, state.answers
    if command is not None and command.valid_until_ns <= now_ns:
        off_ns = command.valid_until_ns
        commander = commander.free_to_switch()._replace(
            switch=commander.switch.forced_off(), reason=None)
        answers = answers.each(lambda each: each.off_since(off_ns))
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


SAVE_PERIOD_S = 60.0
# The State of a killed planner is at most this old [ns]; writing it takes some milliseconds.
RUNNING_PERIOD_NS = 10 * NS_PER_S


class _Kept(NamedTuple):
    """The values of the last write."""

    estimate: Estimate | None = None
    last_seen: LastSeen | None = None
    choices: DriverChoices = NO_CHOICES


class StateKeeper:
    """Reads and writes the file of `state_file`; problems are reported, and preheating works without it."""

    def __init__(self, logger: RcutilsLogger) -> None:
        self._logger = logger
        self._path, self._contents, self._fingerprint = '', b'', ''
        self._written = _Kept()
        # Of the latest write attempt, so that a failure is not repeated with every step.
        self._tried_choices = NO_CHOICES
        # Route and status of the State that was written latest, and its instant.
        self._running: tuple[Mission | None, Status | None] | None = None
        self._running_ns = 0
        self._forget_report()

    def _forget_report(self) -> None:
        # A foreign file is not this planner's, or cannot be read, so it is never written.
        self._problem, self._is_foreign, self._kept_aside = '', False, ''
        self._written_s: float | None = None

    def attach(self, path: str, contents: bytes) -> Recalled:
        """Use a file for the car of a vehicle file; return its contents, empty if it was attached before."""
        if (path, contents) == (self._path, self._contents):
            return Recalled()
        if path != self._path:
            self._forget_report()
        self._path, self._contents, self._written = path, contents, _Kept()
        if not path:
            return Recalled()
        self._fingerprint = vehicle_fingerprint(contents)
        try:
            recalled = load_state(path, self._fingerprint)
        except InvalidInput as error:
            self._fail(str(error), is_foreign=True)
            return Recalled()
        try:
            check_writable(path, make_folder=True)
        except InvalidInput as error:
            self._fail(str(error))
        if recalled.damage:
            self._fail(f'{path}: is damaged: {recalled.damage}; it will be kept aside')
        self._written = _Kept(None, recalled.last_seen, recalled.choices)
        self._tried_choices = recalled.choices
        self._logger.info(
            f'state_file: {path}: nothing learned about this vehicle yet.' if recalled.learned is None
            else f'state_file: {path}: the estimation begins with the learned factors.')
        return recalled

    def save(self, state: State) -> None:
        """Write a Supervisor's knowledge of the car and the driver's choices, if they have changed."""
        kept = _Kept(state.estimate, state.last_seen, state.inbox.choices)
        if not self._path or (kept.estimate is self._written.estimate and kept[1:] == self._written[1:]):
            return
        self._tried_choices = kept.choices
        try:
            kept_aside = save_state(
                self._path, self._fingerprint,
                None if kept.estimate is None else learned_from(kept.estimate), *kept[1:])
        except InvalidInput as error:
            self._fail(str(error), is_foreign=_is_foreign(self._path))
            return
        if kept_aside is not None:
            self._kept_aside = kept_aside
            self._logger.warning(f'state_file: the damaged file was kept as {kept_aside}.')
        if self._problem:
            self._logger.info(f'state_file: {self._path} is written again.')
        self._written, self._problem, self._is_foreign = kept, '', False
        self._running = None
        self._written_s = time.monotonic()

    def save_choices(self, state: State) -> None:
        """Write new choices of the driver at once: a process may be killed at any time."""
        if state.inbox.choices != self._tried_choices:
            self.save(state)

    def running(self, settings: Settings, now_ns: int) -> tuple[State, bytes | None] | None:
        """
        Return the State that a planner of before left beside the file, and its route's message as bytes (CDR).

        Both as they hold at an instant [ns]; None: they do not. The message is None without a route.
        """
        if not self._path or self._is_foreign:
            return None
        try:
            running = self._load_running(settings, now_ns)
        except InvalidInput as error:
            self._logger.warning(f'state_file: {error}; the planner begins without it.')
            return None
        if running is not None:
            ago = duration_text((now_ns - running[0].now_ns) / NS_PER_S)
            self._logger.info(f'state_file: the planner goes on from its state of {ago} ago.')
        return running

    def _load_running(self, settings: Settings, now_ns: int) -> tuple[State, bytes | None] | None:
        """Raise InvalidInput if the file is damaged, or of another version."""
        beside = self._path + SUFFIX
        contents = _contents(beside)
        if not contents:
            return None
        try:
            values = json.loads(contents)
            if values[KEY] != FORMAT:
                raise InvalidInput(f'{beside}: has format {values[KEY]}; this version reads {FORMAT}')
            is_of_this = (values['vehicle_file_sha256'], values['state_file_sha256']) == (
                self._fingerprint, _hash_of(self._path))
            route = None if values['route'] is None else b64decode(values['route'])
            state = state_of(b64decode(values['state'])) if is_of_this else None
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidInput(f'{beside}: is damaged: {type(error).__name__}: {error}') from error
        if state is None or state.settings != settings or not 0 <= now_ns - state.now_ns <= OLDEST_CHOICE_NS:
            return None
        return _as_after_restart(state, now_ns), route

    def keep_running(self, state: State, route: Callable[[], bytes | None]) -> None:
        """
        Write the planner's State beside the file every RUNNING_PERIOD_NS, and at once with a new route or status.

        Also after the file itself was written, to which it belongs. `route()` returns the message of its route as
        bytes, None without one.
        """
        about = state.inbox.latest_mission, state.published_status
        is_due = about != self._running or not 0 <= state.now_ns - self._running_ns < RUNNING_PERIOD_NS
        if not self._path or self._is_foreign or not is_due:
            return
        self._running, self._running_ns = about, state.now_ns
        beside = self._path + SUFFIX
        try:
            message, before = route(), _contents(beside, len(OWN_HEAD))
            if before and not before.startswith(OWN_HEAD):
                raise InvalidInput(f'{beside}: not overwritten: it is not the state of a running planner; name '
                                   'another state file')
            write_whole(beside, json.dumps({
                KEY: FORMAT, 'vehicle_file_sha256': self._fingerprint, 'state_file_sha256': _hash_of(self._path),
                'route': None if message is None else b64encode(message).decode(),
                'state': b64encode(state_bytes(state)).decode()}, separators=(',', ':')),
                make_folder=True, outlasts_power=False)
        except (InvalidInput, TypeError) as error:
            self._fail(str(error))

    def entry(self) -> DiagnosticStatus | None:
        """Return the entry `state file` of the diagnostics; None without one."""
        if not self._path:
            return None
        written = ('nothing written yet' if self._written_s is None
                   else f'written {time.monotonic() - self._written_s:.0f} s ago')
        return entry('state file', ERROR if self._is_foreign else WARN if self._problem else OK,
                     self._problem or written,
                     {'file': self._path, 'last write': written, 'damaged file kept as': self._kept_aside})

    def _fail(self, problem: str, is_foreign: bool = False) -> None:
        if problem != self._problem:
            line = f'state_file: {problem}.'
            # One call for each severity: rclpy raises if a line of code logs with a second one.
            if is_foreign:
                self._logger.error(line)
            else:
                self._logger.warning(line)
        self._problem, self._is_foreign = problem, is_foreign


def _is_foreign(path: str) -> bool:
    """Return whether a path holds a foreign file; False: the file is ours or missing."""
    try:
        check_state_file(path)
    except InvalidInput:
        return True
    return False
