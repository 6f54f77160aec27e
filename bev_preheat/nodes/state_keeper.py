# SPDX-License-Identifier: Apache-2.0
"""Keeps what the planner has learned of the car across restarts of its process."""

from __future__ import annotations

import time
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.memory import learned_from
from bev_preheat.estimation.state_file import check_state_file, load_learned, save_learned
from bev_preheat.files.output_files import check_writable
from bev_preheat.vehicle import vehicle_fingerprint

if TYPE_CHECKING:
    from rclpy.impl.rcutils_logger import RcutilsLogger

    from bev_preheat.estimation.estimate import Estimate
    from bev_preheat.estimation.prior import Learned

SAVE_PERIOD_S = 60.0


class StateFileReport(NamedTuple):
    """
    How it stands with the state file.

    `problem` is a sentence, empty if there is none; `written_s_ago` is None before the first
    write; `kept_aside` is where a damaged file was moved, empty if none was.
    """

    path: str
    problem: str
    written_s_ago: float | None
    kept_aside: str


def check_parameter(path: str) -> None:
    """Raise InvalidInput where the parameter `state_file` names what must not be written over."""
    if path:
        try:
            check_state_file(path)
        except InvalidInput as error:
            raise InvalidInput(
                [f'state_file: {problem}' for problem in error.problems]) from error


class StateKeeper:
    """
    Reads and writes the file of the parameter `state_file`; nothing happens where it is empty.

    What goes wrong is logged and reported: preheating works without a memory.
    """

    def __init__(self, logger: RcutilsLogger) -> None:
        """Take the node's logger."""
        self._logger = logger
        self._path, self._contents, self._fingerprint = '', b'', ''
        self._saved: Estimate | None = None
        self._forget_report()

    def _forget_report(self) -> None:
        self._problem, self._kept_aside = '', ''
        self._written_s: float | None = None

    def attach(self, path: str, contents: bytes) -> Learned | None:
        """
        Use a file for the car whose vehicle file has these contents.

        Returns the Learned that the file holds; None where it holds none or was attached before.
        """
        if (path, contents) == (self._path, self._contents):
            return None
        if path != self._path:
            self._forget_report()
        self._path, self._contents, self._saved = path, contents, None
        if not path:
            return None
        self._fingerprint = vehicle_fingerprint(contents)
        try:
            recalled = load_learned(path, self._fingerprint)
            check_writable(path, make_folder=True)
        except InvalidInput as error:
            self._fail(str(error))
            return None
        if recalled.damage:
            self._fail(f'{path}: is damaged: {recalled.damage}; it will be kept aside')
        if recalled.learned is None:
            self._logger.info(f'state_file: {path}: nothing was learned of this vehicle yet.')
            return None
        self._logger.info(f'state_file: {path}: the estimation begins with what was learned.')
        return recalled.learned

    def save(self, estimate: Estimate | None) -> None:
        """Write what has been learned, an Estimate or None, if it is news."""
        if not self._path or estimate is None or estimate is self._saved:
            return
        try:
            kept_aside = save_learned(self._path, self._fingerprint, learned_from(estimate))
        except InvalidInput as error:
            self._fail(str(error))
            return
        if kept_aside is not None:
            self._kept_aside = kept_aside
            self._logger.warning(f'state_file: the damaged file was kept as {kept_aside}.')
        if self._problem:
            self._logger.info(f'state_file: {self._path} is written again.')
        self._saved, self._problem, self._written_s = estimate, '', time.monotonic()

    def report(self) -> StateFileReport | None:
        """Return the StateFileReport; None where nothing is to be kept."""
        if not self._path:
            return None
        written_s_ago = None if self._written_s is None else time.monotonic() - self._written_s
        return StateFileReport(self._path, self._problem, written_s_ago, self._kept_aside)

    def _fail(self, problem: str) -> None:
        if problem != self._problem:
            self._logger.warning(f'state_file: {problem}.')
        self._problem = problem
