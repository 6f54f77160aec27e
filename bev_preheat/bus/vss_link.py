# SPDX-License-Identifier: Apache-2.0
"""The connection to a VSS databroker (KUKSA): subscribes in threads, publishes, watches that it lives."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from functools import partial
from threading import Event, Lock, Thread
import time
from typing import Any, TYPE_CHECKING

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.input_files import read_text
from bev_preheat.optional_packages import require

if TYPE_CHECKING:
    from bev_preheat.bus.live_map import VssSettings

# A call of the broker takes at most CALL_S; it is asked for a sign of life every HEARTBEAT_S.
CALL_S, HEARTBEAT_S, RECONNECT_S = 2.0, 0.5, 1.0
ROOT = 'Vehicle'
# gRPC's number for a call that the broker does not have: an answer all the same.
UNIMPLEMENTED = 12

# A value of a datapoint, None if the broker has none; and its age [s], None if it has no stamp.
ValueReceiver = Callable[[str, Any, float | None], None]
# Values that are requested of actuators, by path.
RequestReceiver = Callable[[Mapping[str, Any]], None]


class VssLink:
    """
    Keeps a connection; `problem` is '' while it works, else a sentence.

    `on_paths` is called with the unit of each path at each connection, and returns the paths to subscribe to;
    `on_value` with every value of these; `on_request` with the values requested of `actuators`. All run in
    the link's threads. `alive` is called whenever the broker has answered.
    """

    def __init__(self, settings: VssSettings, on_paths: Callable[[Mapping[str, str]], Collection[str]],
                 on_value: ValueReceiver, on_request: RequestReceiver, actuators: Collection[str],
                 alive: Callable[[], None]) -> None:
        """Take the settings and receivers; raises InvalidInput if a file cannot be read. `start` connects."""
        require('kuksa_client')
        self._settings = settings
        self._token = text_of(settings.token, 'live.vss.token')
        text_of(settings.root_certificates, 'live.vss.root_certificates')
        self._on_paths, self._on_value, self._on_request = on_paths, on_value, on_request
        self._actuators, self._alive = tuple(actuators), alive
        self._ended, self._wake, self._lock = Event(), Event(), Lock()
        self._outgoing: dict[str, Any] = {}
        self._known: frozenset[str] = frozenset()
        self._thread = Thread(target=self._run, name='vss', daemon=True)
        self.problem = 'is not connected yet'
        self.unpublished = ''
        self.connections = self.updates = 0
        self.name = f'VSS {settings.host}:{settings.port}'

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

    def _run(self) -> None:
        while not self._ended.is_set():
            lost = Event()
            try:
                with self._client() as client:
                    self._serve(client, lost)
            except Exception as error:
                # The client passes on errors of gRPC and of its own.
                self.problem = f'{_in_words(error)}; it is tried again'
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
        wanted = list(self._on_paths(units))
        self._alive()
        self.connections += 1
        self.problem = ''
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
        raise ConnectionError(self.problem or 'a subscription has ended')

    def _beat(self, client: Any) -> None:
        from kuksa_client.grpc import VSSClientError
        try:
            client.get_server_info(timeout=CALL_S)
        except VSSClientError as error:
            if error.error.get('code') != UNIMPLEMENTED:
                raise
        self._alive()

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
                    self.problem = _in_words(error)
            lost.set()
            self._wake.set()

        Thread(target=follow, name='vss subscription', daemon=True).start()

    def _take_values(self, updates: Mapping[str, Any]) -> None:
        self.updates += 1
        for path, datapoint in updates.items():
            stamp = None if datapoint is None else datapoint.timestamp
            self._on_value(path, None if datapoint is None else datapoint.value,
                           None if stamp is None else time.time() - stamp.timestamp())

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
            self.unpublished = ''
        except Exception as error:
            # A broker may refuse a value while it serves all others.
            self.unpublished = f'{", ".join(outgoing)} could not be published: {_in_words(error)}'


def text_of(path: Any, key: str) -> str | None:
    """Return the text of a file, None without a path; InvalidInput names the key."""
    if path is None:
        return None
    try:
        return read_text(path).strip()
    except InvalidInput as error:
        raise InvalidInput([f'{key}: {problem}' for problem in error.problems]) from error


def _in_words(error: Exception) -> str:
    details = getattr(error, 'error', None)
    with suppress(Exception):
        if details:
            return f'{details.get("reason", type(error).__name__)}: {quoted(str(details.get("message", "")))}'
    return f'{type(error).__name__}: {quoted(str(error))}'
