# SPDX-License-Identifier: Apache-2.0
"""A VSS databroker as a live source: values come on change only, and hold while the connection lives."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
import math
from typing import Any, TYPE_CHECKING

from bev_preheat.bus.readings import live_channels, LiveChannel
from bev_preheat.bus.source import LiveSource
from bev_preheat.bus.vss_link import VssLink
from bev_preheat.errors import figure, InvalidInput, quoted
from bev_preheat.files.units import unit_named

if TYPE_CHECKING:
    from bev_preheat.bus.live_map import LiveMap
    from bev_preheat.bus.vss_link import RequestReceiver

# A value may be stamped this far in the future [s].
STAMPED_AHEAD_S = 1.0


class VssSource(LiveSource):
    """A VSS databroker."""

    def __init__(self, live_map: LiveMap, clock_s: Callable[[], float], on_request: RequestReceiver,
                 actuators: Collection[str] = ()) -> None:
        """
        Take a map with `vss`, and the clock [s] of the readings' instants; raises InvalidInput.

        `on_request` is called, in a thread of the connection, with the values requested of `actuators`.
        """
        assert live_map.vss is not None
        super().__init__(live_map, clock_s, {}, -math.inf)
        self._wanted: dict[str, list[tuple[str, LiveChannel]]] = {}
        self._mismatch = ''
        self._link = VssLink(live_map.vss, self._on_paths, self._on_value, on_request,
                             actuators if live_map.vss.conditioning else (), self._on_alive)
        self.name = self._link.name

    @property
    def problem(self) -> str:
        """'' while the broker answers and has the signals, else a sentence."""
        return self._link.problem or self._mismatch

    @property
    def connections(self) -> int:
        """How many times the broker has been reached."""
        return self._link.connections

    def start(self) -> None:
        """Connect in a thread."""
        self._link.start()

    def close(self) -> None:
        """End the connection."""
        self._link.close()

    def publish(self, values: Mapping[str, Any]) -> None:
        """Publish values by path."""
        self._link.publish(values)

    def doubts(self, now_s: float) -> dict[str, str]:
        """Return a sentence on the latest dropped input of each cause."""
        unpublished = self._link.unpublished
        return {**super().doubts(now_s), **({'publish': unpublished} if unpublished else {})}

    def figures(self) -> dict[str, str]:
        """Return figures for the diagnostics."""
        return {'updates': str(self._link.updates), 'reconnects': str(max(self._link.connections - 1, 0)),
                'paths': ', '.join(self._wanted) or 'none'}

    def _on_paths(self, units: Mapping[str, str]) -> list[str]:
        """Choose the paths of the signals; those of a broker that was replaced may differ."""
        where = str(self._map.signals.path)
        try:
            channels = live_channels(
                self._map.sources, {path: unit_named(unit) for path, unit in units.items()}, where)
            lacking = [name for name in self._map.required if not channels[name]]
            self._mismatch = '' if not lacking else (
                f'does not have {", ".join(lacking)}; the signal map {where} names them')
        except InvalidInput as error:
            channels, self._mismatch = {}, str(error)
        wanted: dict[str, list[tuple[str, LiveChannel]]] = {}
        for signal, groups in channels.items():
            for channel in {each.name: each for group in groups for each in group}.values():
                wanted.setdefault(channel.name, []).append((signal, channel))
        charging = self._map.charging_channel
        if charging is not None and charging in units:
            wanted.setdefault(charging, [])
        # Values of an earlier connection may have changed unseen.
        self._readings.forget()
        self._channels, self._wanted = channels, wanted
        return list(wanted)

    def _on_value(self, path: str, value: Any, age_s: float | None) -> None:
        now_s = self._clock_s()
        if path == self._map.charging_channel:
            self._put('charging', path, None, value, age_s, now_s)
        for signal, channel in self._wanted.get(path, ()):
            self._put(signal, path, channel, value, age_s, now_s)

    def _put(self, signal: str, path: str, channel: LiveChannel | None, value: Any, age_s: float | None,
             now_s: float) -> None:
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

    def _on_alive(self) -> None:
        self._confirmed_s = self._clock_s()
