# SPDX-License-Identifier: Apache-2.0
"""The files of the parameters `departures` and `grid_prices`, and the service that skips a departure."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC
import math
import os
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from std_srvs.srv import SetBool

from bev_preheat.control.departure_source import DepartureSource, DepartureState
from bev_preheat.control.departures import Departures, GridPrices, load_departures, load_grid_prices
from bev_preheat.control.events import Event
from bev_preheat.control.preparation_goal import PreparationOutcome
from bev_preheat.control.state import State
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.diagnostics import entry, ERROR, OK, WARN
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text

SKIP = '~/skip_departure'
DEPARTURES, GRID_PRICES = 'departures', 'grid_prices'
# In place of a file that cannot be used.
NO_DEPARTURES = DepartureSource(Departures(UTC, ()), reason='the file of departures cannot be used')
# A departure that is held off is worth a warning this close to it [s].
HELD_OFF_TOLD_S = 7200.0


class _WatchedFile:
    """A file that is read again when it has changed; its latest good contents stay in use."""

    def __init__(self, name: str, load: Callable[[str], Any], logger: RcutilsLogger) -> None:
        self._name, self._load, self._logger = name, load, logger
        self.path, self.contents, self.problem = '', None, ''
        self._stamp: object = None

    def attach(self, path: str) -> None:
        """Use a file from now on; '' for none."""
        if path != self.path:
            self.path, self.contents, self.problem, self._stamp = path, None, '', None
        self.look()

    def look(self) -> bool:
        """Read the file if it has changed; return whether there are new contents."""
        if not self.path:
            return False
        stamp = _stamp(self.path)
        if stamp is not None and stamp == self._stamp:
            return False
        is_news, self._stamp = stamp != self._stamp, stamp
        try:
            self.contents = self._load(self.path)
        except InvalidInput as error:
            used = 'the contents from before stay in use' if self.contents is not None else 'it is not used'
            problem = f'{self._name}: {error}; {used}'
            if is_news or problem != self.problem:
                self._logger.error(f'{problem}.')
            self.problem = problem
            return False
        self.problem = ''
        return True


class DepartureKeeper:
    """Feeds a DepartureSource from files, and offers the service ~/skip_departure."""

    def __init__(self, node: Node, step: Callable[[Event], object], supervisor: Supervisor,
                 last_seen_ns: int | None) -> None:
        """
        Begin without files.

        `step(event)` runs a step of the Supervisor; `last_seen_ns` [ns] is the battery's latest state before a
        restart, None: unknown.
        """
        self._node, self._step, self._supervisor = node, step, supervisor
        self._last_seen_ns = last_seen_ns
        logger = node.get_logger()
        self._departures = _WatchedFile(DEPARTURES, load_departures, logger)
        self._prices = _WatchedFile(GRID_PRICES, load_grid_prices, logger)
        self._source: DepartureSource | None = None
        self._told = ''
        node.create_service(SetBool, SKIP, self._on_skip)

    @property
    def prices(self) -> GridPrices | None:
        """The prices of energy from the grid; None without a file."""
        prices: GridPrices | None = self._prices.contents
        return prices

    def attach(self, departures_path: str, prices_path: str) -> tuple[Event, ...]:
        """Use these files from now on, '' for none; return the event that ends a goal of departures taken away."""
        self._departures.attach(departures_path)
        self._prices.attach(prices_path)
        return self._use()

    def look(self) -> None:
        """Read files that have changed."""
        if any([self._departures.look(), self._prices.look()]):
            self._use()
            self._node.get_logger().info('Departures or prices were read again, because the file has changed.')

    def _use(self) -> tuple[Event, ...]:
        departures: Departures | None = self._departures.contents
        if departures is None:
            source, self._source = self._source, None
            return () if source is None else source.given_up()
        if self._source is None:
            self._source = DepartureSource(departures, self.prices, self._last_seen_ns)
            # Later ones did not pass while the planner was down.
            self._last_seen_ns = None
        else:
            self._source = self._source.using(departures, self.prices)
        return ()

    def events(self, state: State, now_ns: int) -> tuple[Event, ...]:
        """Return the events of an instant [ns]; mostly ()."""
        if self._source is None:
            return ()
        self._source, events = self._source.events(state, now_ns)
        latest = self._source.latest
        if latest != self._told:
            self._told = latest
            self._node.get_logger().info(f'departures: {latest}')
        return events

    def note(self, outcome: PreparationOutcome, state: State, now_ns: int) -> None:
        """Take in the PreparationOutcome of any goal."""
        if self._source is not None:
            self._source = self._source.noted(outcome, state, now_ns)

    def entry(self, now_ns: int) -> DiagnosticStatus | None:
        """Return the entry `departures` of the diagnostics at an instant [ns]; None without such a file."""
        if not self._departures.path:
            return None
        source = self._source or NO_DEPARTURES
        following = source.following
        problems = [*filter(None, (self._departures.problem, self._prices.problem))]
        next_words, left_s, target = '', math.inf, ''
        sentence = f'{source.state.value}: {source.reason}'
        if following is not None:
            next_words, left_s = source.departures.in_words(following), (following.instant_ns - now_ns) / NS_PER_S
            sentence = f'{next_words}, in {duration_text(left_s)}: {sentence}'
            target_c = following.departure.target_c
            target = "the planner's default" if target_c is None else f'{target_c:g}'
        is_late = source.state is DepartureState.HELD_OFF and left_s < HELD_OFF_TOLD_S
        level = ERROR if problems and following is None else WARN if problems or is_late else OK
        return entry('departures', level, '; '.join([sentence, *problems]), {
            'next departure': next_words,
            'next departure [s since 1970]': '' if following is None else str(following.instant_ns // NS_PER_S),
            'next departure in [s]': '' if following is None else f'{left_s:.0f}',
            'target [degC]': target,
            'plugged in': str(source.is_plugged_in).lower(),
            'state': source.state.value,
            'reason': source.reason,
            'skipped': source.skipped,
            'latest departure': source.latest,
            'departures': self._departures.path,
            'grid_prices': self._prices.path})

    def _on_skip(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if self._source is None:
            response.message = 'There are no departures: the parameter departures names no file that can be used.'
            return response
        state, now_ns = self._supervisor.state, self._node.get_clock().now().nanoseconds
        event, response.message = (
            self._source.skip_next(state, now_ns) if request.data else self._source.unskip(now_ns))
        if event is not None:
            response.success = True
            self._node.get_logger().info(response.message)
            self._step(event)
            for following in self.events(self._supervisor.state, now_ns):
                # At once, so that heating for a skipped departure stops with the answer.
                self._step(following)
        return response


def _stamp(path: str) -> object:
    """Return a value that changes with a file's contents; None if there is no file."""
    try:
        found = os.stat(os.path.expanduser(path))
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino
