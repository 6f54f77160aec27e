# SPDX-License-Identifier: Apache-2.0
"""A VSS databroker (KUKSA) as a live source: values come on change only, and hold while the connection lives."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from functools import partial
import math
from threading import Event, Lock, Thread
import time
from typing import Any

from bev_preheat.bus.live_map import CHARGING, LiveMap
from bev_preheat.bus.source import by_channel, live_channels, LiveChannel, LiveSource
from bev_preheat.errors import figure, InvalidInput, located, LONGEST_PROBLEM, quoted, shortened
from bev_preheat.files.input_files import read_text
from bev_preheat.files.units import unit_named
from bev_preheat.optional_packages import require

# A call of the broker takes at most CALL_S; it is asked for a sign of life every HEARTBEAT_S.
CALL_S, HEARTBEAT_S, RECONNECT_S = 2.0, 0.5, 1.0
ROOT = 'Vehicle'
# gRPC's number for a call that the broker does not have: an answer all the same.
UNIMPLEMENTED = 12

# A value may be stamped this far in the future [s].
STAMPED_AHEAD_S = 1.0


class VssSource(LiveSource):
    """
    A VSS databroker, whose connection is kept open.

    The subscriptions, the values requested of actuators and the connection itself have threads of their own.
    """

    def __init__(self, live_map: LiveMap, clock_s: Callable[[], float],
                 on_request: Callable[[Mapping[str, Any]], None], actuators: Collection[str] = ()) -> None:
        """
        Take a map with `vss`, and the clock [s] of the readings' instants; raises InvalidInput. `start` connects.

        `on_request` is called, in a thread of the connection, with the values requested of `actuators` by path.
        """
        settings = live_map.vss
        assert settings is not None
        super().__init__(live_map, clock_s, {}, -math.inf)
        require('kuksa_client')
        self._settings, self._token = settings, text_of(settings.token, 'live.vss.token')
        text_of(settings.root_certificates, 'live.vss.root_certificates')
        self.name = f'VSS {settings.host}:{settings.port}'
        self._on_request, self._actuators = on_request, tuple(actuators) if settings.conditioning else ()
        self._wanted: dict[str, list[tuple[str, LiveChannel | None]]] = {}
        # The broker's paths, and problems with the connection, the signals and the latest published values.
        self._known: frozenset[str] = frozenset()
        self._lost, self._mismatch, self._unpublished = 'is not connected yet', '', ''
        self._ended, self._wake, self._lock = Event(), Event(), Lock()
        self._outgoing: dict[str, Any] = {}
        # Numbers of connections and of updates.
        self.connections = self._updates = 0
        self._thread = Thread(target=self._run, name='vss', daemon=True)

    @property
    def problem(self) -> str:
        """'' while the broker answers and has the signals, else a sentence."""
        return self._lost or self._mismatch

    def start(self) -> None:
        """Connect in a thread; a broker that cannot be reached is tried again."""
        self._thread.start()

    def close(self) -> None:
        """Publish the last values, and end the connection."""
        self._ended.set()
        self._wake.set()
        if self._thread.ident is not None:
            self._thread.join(timeout=2.0 * CALL_S)

    def publish(self, values: Mapping[str, Any]) -> None:
        """Publish values by path soon; a path that the broker does not have is left out."""
        with self._lock:
            self._outgoing.update(values)
        self._wake.set()

    def doubts(self) -> dict[str, str]:
        """Return a sentence on the latest dropped input of each cause, and on values that are not published."""
        return {**super().doubts(), **({'publish': self._unpublished} if self._unpublished else {})}

    def figures(self) -> dict[str, str]:
        """Return figures for the diagnostics."""
        return {'updates': str(self._updates), 'reconnects': str(max(self.connections - 1, 0)),
                'paths': ', '.join(self._wanted) or 'none'}

    # The connection

    def _run(self) -> None:
        while not self._ended.is_set():
            lost = Event()
            try:
                with self._client() as client:
                    self._serve(client, lost)
            except Exception as error:
                # The client passes on errors of gRPC and of its own.
                self._lost = f'{_in_words(error)}; it is tried again'
            lost.set()
            self._ended.wait(RECONNECT_S)

    def _client(self) -> Any:
        from kuksa_client.grpc import VSSClient
        settings = self._settings
        return VSSClient(settings.host, settings.port, token=self._token,
                         root_certificates=settings.root_certificates,
                         tls_server_name=settings.tls_server_name, ensure_startup_connection=False)

    def _serve(self, client: Any, lost: Event) -> None:
        metadata = client.get_metadata([ROOT], timeout=CALL_S)
        units = {path: (entry.unit or '') if entry is not None else '' for path, entry in metadata.items()}
        self._known = frozenset(units)
        wanted = self._choose(units)
        self._confirmed_s = self._clock_s()
        self.connections += 1
        self._lost = ''
        if wanted:
            self._follow(partial(client.subscribe_current_values, wanted), self._take_values, lost)
        actuators = [path for path in self._actuators if path in units]
        if actuators:
            self._follow(partial(client.subscribe_target_values, actuators), self._take_requests, lost)
        while not lost.is_set():
            self._publish_outgoing(client)
            if self._ended.is_set():
                return
            self._beat(client)
            self._wake.wait(HEARTBEAT_S)
            self._wake.clear()
        raise ConnectionError(self._lost or 'a subscription has ended')

    def _beat(self, client: Any) -> None:
        from kuksa_client.grpc import VSSClientError
        try:
            client.get_server_info(timeout=CALL_S)
        except VSSClientError as error:
            if error.error.get('code') != UNIMPLEMENTED:
                raise
        self._confirmed_s = self._clock_s()

    def _follow(self, subscribe: Callable[[], Iterator[Mapping[str, Any]]],
                take: Callable[[Mapping[str, Any]], None], lost: Event) -> None:
        """Pass a subscription's updates on in a thread, until it ends."""
        def follow() -> None:
            try:
                for updates in subscribe():
                    if lost.is_set():
                        return
                    take(updates)
            except Exception as error:
                # Errors of gRPC, also when the connection is closed on purpose.
                if not lost.is_set():
                    self._lost = _in_words(error)
            lost.set()
            self._wake.set()

        Thread(target=follow, name='vss subscription', daemon=True).start()

    def _take_values(self, updates: Mapping[str, Any]) -> None:
        self._updates += 1
        for path, datapoint in updates.items():
            stamp = None if datapoint is None else datapoint.timestamp
            age_s = None if stamp is None else time.time() - stamp.timestamp()
            for signal, channel in self._wanted.get(path, ()):
                self._put(signal, path, channel, None if datapoint is None else datapoint.value, age_s)

    def _take_requests(self, updates: Mapping[str, Any]) -> None:
        values = {path: datapoint.value for path, datapoint in updates.items()
                  if datapoint is not None and datapoint.value is not None}
        if values:
            self._on_request(values)

    def _publish_outgoing(self, client: Any) -> None:
        from kuksa_client.grpc import Datapoint
        with self._lock:
            outgoing, self._outgoing = self._outgoing, {}
        outgoing = {path: value for path, value in outgoing.items() if path in self._known}
        if not outgoing:
            return
        try:
            client.set_current_values({path: Datapoint(value) for path, value in outgoing.items()}, timeout=CALL_S)
            self._unpublished = ''
        except Exception as error:
            # A broker may refuse a value while it serves all others.
            self._unpublished = f'{", ".join(outgoing)} could not be published: {_in_words(error)}'

    # Its values

    def _choose(self, units: Mapping[str, str]) -> list[str]:
        """Return the paths of the signals, among those with their units; a broker that was replaced has others."""
        where = str(self._map.signals.path)
        try:
            channels = live_channels(
                self._map.sources, {path: unit_named(unit) for path, unit in units.items()}, where)
            lacking = [name for name in self._map.required if not channels[name]]
            self._mismatch = '' if not lacking else (
                f'does not have {", ".join(lacking)}; the signal map {where} names them')
        except InvalidInput as error:
            channels, self._mismatch = {}, str(error)
        wanted: dict[str, list[tuple[str, LiveChannel | None]]] = {
            path: [*readers] for path, readers in by_channel(channels).items()}
        charging = self._map.charging_channel
        if charging is not None and charging in units:
            wanted.setdefault(charging, []).append((CHARGING, None))
        # Values of an earlier connection may have changed unseen.
        self._readings.forget()
        self._channels, self._wanted = channels, wanted
        return list(wanted)

    def _put(self, signal: str, path: str, channel: LiveChannel | None, value: Any, age_s: float | None) -> None:
        """Take in a value, None if the broker has none, of some age [s], None if it has no stamp."""
        now_s = self._clock_s()
        try:
            if value is None:
                raise InvalidInput(f'{path}: has no value')
            if not isinstance(value, int | float):
                raise InvalidInput(f'{path}: {quoted(str(value))} is no number')
            if age_s is not None and age_s < -STAMPED_AHEAD_S:
                raise InvalidInput(f'{path}: its stamp is {figure(-age_s, 3)} s ahead of the clock; at most '
                                   f'{STAMPED_AHEAD_S:g} s are allowed')
            number = float(value) if channel is None else channel.read(float(value))
            self._readings.put(signal, path, number, now_s - max(age_s or 0.0, 0.0))
        except InvalidInput as error:
            # The value before has been replaced, so it no longer holds.
            self._readings.drop(signal, path)
            self._readings.doubt(path, str(error), now_s)


def text_of(path: Any, key: str) -> str | None:
    """Return the text of a file, None without a path; InvalidInput names the key."""
    if path is None:
        return None
    with located(key):
        return read_text(path).strip()


def _in_words(error: Exception) -> str:
    reason, message, details = type(error).__name__, str(error), getattr(error, 'error', None)
    with suppress(Exception):
        if details:
            reason, message = details.get('reason', reason), str(details.get('message', ''))
    return f'{reason}: {shortened(message, LONGEST_PROBLEM)!r}'
