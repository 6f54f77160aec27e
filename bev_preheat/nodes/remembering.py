# SPDX-License-Identifier: Apache-2.0
"""Keeps what the planner has learned of the car across restarts of its process."""

from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.memory import learned_from, load_learned, save_learned

SAVE_PERIOD_S = 60.0


class Remembering:
    """
    Reads and writes the file of the parameter `state_file`; nothing happens where it is empty.

    What goes wrong is logged: preheating works without a memory.
    """

    def __init__(self, logger):
        """Take the node's logger."""
        self._logger = logger
        self._path, self._fingerprint = '', ''
        self._saved = None

    def attach(self, path, fingerprint, supervisor):
        """Use a file for the car with this fingerprint; what it holds goes to the supervisor."""
        if (path, fingerprint) == (self._path, self._fingerprint):
            return
        self._path, self._fingerprint = path, fingerprint
        if not path:
            return
        try:
            learned = load_learned(path, fingerprint)
        except InvalidInput as error:
            self._logger.warning(f'state_file is ignored: {error}')
            return
        if learned is None:
            self._logger.info(f'state_file: {path} will be written.')
            return
        supervisor.recall(learned.factors, learned.covariance)
        self._logger.info(f'state_file: {path}: the estimation begins with what was learned.')

    def save(self, supervisor):
        """Write what has been learned, if it is news."""
        estimate = supervisor.estimate
        if not self._path or estimate is None or estimate is self._saved:
            return
        try:
            save_learned(self._path, self._fingerprint, learned_from(estimate))
        except OSError as error:
            self._logger.warning(f'state_file: {self._path}: cannot be written: '
                                 f'{error.strerror}', throttle_duration_sec=600.0)
            return
        self._saved = estimate
