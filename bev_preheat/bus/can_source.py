# SPDX-License-Identifier: Apache-2.0
"""A CAN bus as a live source, and the way back for the heater's command."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from functools import partial
import logging
from threading import Event, Lock, Thread
import time
from typing import Any

from bev_preheat.bus.can_decoder import BusMessages, CanDecoder, FOLLOWED, HEATER_FAULT, HEATER_POWER, reading_of
from bev_preheat.bus.heater_frame import HeaterFrame
from bev_preheat.bus.live_map import CanSettings, LiveMap, REPLAY
from bev_preheat.bus.source import age_of_stamp, LiveSource
from bev_preheat.errors import InvalidInput, located, LONGEST_PROBLEM, quoted, shortened
from bev_preheat.logs.can_frames import recorded_frames
from bev_preheat.logs.dbc import identifying_bits
from bev_preheat.optional_packages import require
from bev_preheat.vehicle.description import HVCH

# How long one wait for a frame lasts [s]; the thread ends within it.
FRAME_WAIT_S = 0.1
# If the thread did not get on for this long, frames may have queued; the queue is dropped [s].
STALLED_S = 0.5
MOST_QUEUED = 100_000
CAN_RECONNECT_S = 1.0
# Error frames: class bits in the identifier (linux/can/error.h).
BUS_OFF, RESTARTED = 0x40, 0x100
# Packages of interfaces that python-can does not bring along.
PACKAGES = {'slcan': 'serial', 'serial': 'serial', 'robotell': 'serial'}

# Called with identifier, whether it has 29 bits, data, age [s].
Receiver = Callable[[int, bool, bytes, float], None]


class ReplayBus:
    """The frames of a candump, ASC or BLF file, received as from a bus; frames that are sent go nowhere."""

    def __init__(self, path: str) -> None:
        """Open a file; raises InvalidInput if it is no recording of CAN frames."""
        self._frames: Iterator[Any] = recorded_frames(path)
        first = next(self._frames, None)
        if first is None:
            raise InvalidInput(f'{path}: has no CAN frames')
        self._next: Any = first
        self._offset_s = time.monotonic() - first.timestamp

    def recv(self, timeout: float) -> Any:
        """Return the next frame once it is due, None if none is due within `timeout` [s]."""
        if self._next is None:
            time.sleep(timeout)
            return None
        wait_s = self._next.timestamp + self._offset_s - time.monotonic()
        if wait_s > timeout:
            time.sleep(timeout)
            return None
        if wait_s > 0.0:
            time.sleep(wait_s)
        frame, self._next = self._next, next(self._frames, None)
        # It arrives now, whenever it was recorded.
        frame.timestamp = 0.0
        return frame

    def send(self, message: Any, timeout: float | None = None) -> None:
        """Take a frame and do nothing: a recording has no receiver."""

    def shutdown(self) -> None:
        """Close the file."""
        self._next = None
        self._frames = iter(())


class CanLink:
    """Keeps a bus open (`problem`: '' or a sentence); its thread passes frames of `identifiers` to `receive`."""

    def __init__(self, settings: CanSettings, identifiers: Collection[tuple[int, bool]],
                 receive: Receiver, has_fd: bool = False) -> None:
        """
        Take the settings, and whether frames of CAN FD are used; `start` opens the bus.

        Raises InvalidInput if python-can knows no such interface.
        """
        require('can', *([PACKAGES[settings.interface]] if settings.interface in PACKAGES else []))
        import can
        known = sorted(map(str, can.VALID_INTERFACES))
        if settings.interface not in (*known, REPLAY):
            raise InvalidInput(f'live.can.interface: {quoted(settings.interface)} is unknown; known: '
                               f'{", ".join((REPLAY, *known))}')
        if settings.interface == REPLAY:
            # A recording that cannot be read is a wrong setting; a bus may be connected later.
            ReplayBus(str(settings.channel)).shutdown()
        self._settings, self._receive, self._has_fd = settings, receive, has_fd
        self._filters = [{'can_id': identifier, 'can_mask': identifying_bits(identifier, is_extended),
                          'extended': is_extended} for identifier, is_extended in identifiers]
        self._lock, self._ended = Lock(), Event()
        self._bus: Any = None
        self._thread = Thread(target=self._run, name='can', daemon=True)
        self.name, self.problem = f'{settings.interface} {settings.channel}', 'is not open yet'
        self.frames = 0
        self.reconnects = -1

    def start(self) -> None:
        """Open the bus and receive; a bus that cannot be opened is tried again."""
        self._thread.start()

    def close(self) -> None:
        """End the thread and close the bus."""
        self._ended.set()
        if self._thread.ident is not None:
            self._thread.join(timeout=2.0)
        self._shut()

    def send(self, identifier: int, is_extended: bool, data: bytes, is_fd: bool = False) -> str:
        """Send a frame; return '' or a sentence on the reason that it was not sent."""
        import can
        with self._lock:
            bus = self._bus
            if bus is None or self.problem:
                return f'{self.name}: {self.problem or "is closed"}'
            try:
                bus.send(can.Message(arbitration_id=identifier, is_extended_id=is_extended, data=data,
                                     is_fd=is_fd), timeout=0.0)
            except Exception as error:
                # python-can passes on errors of drivers, such as a full buffer or a bus that is off.
                return f'{self.name}: a frame could not be sent ({quoted(str(error))})'
        return ''

    def _run(self) -> None:
        logging.getLogger('can').setLevel(logging.CRITICAL)
        while not self._ended.is_set():
            try:
                bus = self._open()
                with self._lock:
                    self._bus, self.problem = bus, ''
                self.reconnects += 1
                self._receive_frames(bus)
            except Exception as error:
                # python-can passes on errors of drivers and of the operating system.
                self.problem = (f'{type(error).__name__}: {shortened(str(error), LONGEST_PROBLEM)!r}; '
                                'it is tried again')
            self._shut()
            self._ended.wait(CAN_RECONNECT_S)

    def _open(self) -> Any:
        import can
        settings = self._settings
        if settings.interface == REPLAY:
            return ReplayBus(str(settings.channel))
        options = dict(settings.options)
        if settings.bitrate is not None:
            options['bitrate'] = settings.bitrate
        if self._has_fd:
            options.setdefault('fd', True)
        if settings.interface == 'slcan':
            # The library waits two seconds for the first Arduinos; adapters of today need no time.
            options.setdefault('sleep_after_open', 0.0)
        return can.Bus(interface=settings.interface, channel=settings.channel, can_filters=self._filters,
                       **options)

    def _receive_frames(self, bus: Any) -> None:
        before_s = time.monotonic()
        while not self._ended.is_set():
            frame = bus.recv(FRAME_WAIT_S)
            now_s = time.monotonic()
            if now_s - before_s > STALLED_S:
                # The process was stopped. Drivers without stamps of their own would pass old frames off as new.
                for _ in range(MOST_QUEUED):
                    if bus.recv(0.0) is None:
                        break
                frame = None
            before_s = now_s
            if frame is not None:
                self._take(frame)

    def _take(self, frame: Any) -> None:
        if frame.is_error_frame:
            if frame.arbitration_id & BUS_OFF:
                self.problem = 'bus off: the controller has seen too many errors; check wiring and bit rate'
            elif frame.arbitration_id & RESTARTED:
                self.problem = ''
            return
        if frame.is_remote_frame or not getattr(frame, 'is_rx', True):
            return
        # A frame that arrives shows that the bus is on again.
        self.problem = ''
        self.frames += 1
        self._receive(frame.arbitration_id, frame.is_extended_id, bytes(frame.data), age_of_stamp(frame.timestamp))

    def _shut(self) -> None:
        with self._lock:
            bus, self._bus = self._bus, None
            if bus is not None:
                with suppress(Exception):
                    bus.shutdown()


# The readings that a set-point follows are valid for as long as those of this signal.
TEMPERATURE = 'battery_temperature_c'


class CanSource(LiveSource):
    """A CAN bus, or several. `frames` are the HeaterFrames of the heat sources that the map commands, by name."""

    def __init__(self, live_map: LiveMap, clock_s: Callable[[], float],
                 vehicle_powers_w: Mapping[str, float] | None = None) -> None:
        """
        Take a map with `can`, and the clock [s] of the readings' instants; raises InvalidInput.

        `vehicle_powers_w` [W] are maximum powers of heat sources in the vehicle file by name, as far as known.
        """
        assert live_map.can
        messages, powers_w = BusMessages(live_map), {} if vehicle_powers_w is None else vehicle_powers_w
        self.frames = {name: HeaterFrame(
            rules.command, messages.by_name, str(live_map.signals.path), powers_w.get(name), f'{rules.key}command')
            for name, rules in live_map.heaters.items()}
        self._decoder = CanDecoder(live_map, messages, self.frames)
        super().__init__(live_map, clock_s, self._decoder.channels)
        bus_of = {name: messages.bus[rules.command.message] for name, rules in live_map.heaters.items()}
        with located(live_map.signals.path):
            self._links = [CanLink(
                settings, self._decoder.identifiers[number], partial(self.on_frame, number),
                self._decoder.has_fd[number] or any(
                    bus == number and self.frames[name].is_fd for name, bus in bus_of.items()))
                for number, settings in enumerate(live_map.can)]
        self._link_of = {name: self._links[bus] for name, bus in bus_of.items()}
        self.name = ' and '.join(link.name for link in self._links)

    @property
    def problem(self) -> str:
        """'' while all buses work, else a sentence."""
        if len(self._links) == 1:
            return self._links[0].problem
        return '; '.join(f'{link.name}: {link.problem}' for link in self._links if link.problem)

    def start(self) -> None:
        """Receive in a thread for each bus; a bus that cannot be opened is tried again."""
        for link in self._links:
            link.start()

    def close(self) -> None:
        """End the threads and close the buses."""
        for link in self._links:
            link.close()

    def heaters_problem(self, heater: str) -> str:
        """Return '' while the bus of a heat source's command works, else a sentence that names it."""
        link = self._link_of[heater]
        return f'{link.name}: {link.problem}' if link.problem else ''

    def figures(self) -> dict[str, str]:
        """Return figures for the diagnostics."""
        checks = [f'{check.message.name} ({", ".join(words)})' for check in self._decoder.checks
                  if (words := check.in_words())]
        return {'frames': str(sum(link.frames for link in self._links)),
                'reconnects': str(sum(max(link.reconnects, 0) for link in self._links)),
                'checks beyond length and limits': ', '.join(checks) or 'none'}

    def heater_status(self, heater: str = HVCH) -> tuple[float | None, str]:
        """Return a heat source's measured power [W] (None: unknown), and a sentence on a fault or silence."""
        rule = self._map.heaters[heater].status
        measured_w, fault, follows = None, '', self.frames[heater].follows
        if follows is not None and self._followed_c(heater) is None:
            fault = (f'no valid {follows} for {self._map.valid_for_s[TEMPERATURE]:g} s, which the set-point '
                     'follows')
        for signal, channel in ((HEATER_POWER, rule.power), (HEATER_FAULT, rule.fault)):
            if channel is None:
                continue
            value = self._valid(reading_of(signal, heater), channel, rule.valid_for_s)
            if value is None:
                fault = f'no valid {channel} for {rule.valid_for_s:g} s'
            elif signal == HEATER_POWER:
                measured_w = value
            elif value != 0.0:
                fault = f'{channel}: {self._decoder.value_in_words(channel, value)}'
        return measured_w, fault

    def _valid(self, signal: str, channel: str, valid_for_s: float) -> float | None:
        reading, now_s = self._readings.latest(signal, channel), self._clock_s()
        return reading.value if reading is not None and 0.0 <= now_s - reading.instant_s <= valid_for_s else None

    def send_power(self, power_w: float, heater: str = HVCH) -> str:
        """Send the next frame of a heat source's command [W]; return '' or why it was not sent."""
        frame = self.frames[heater]
        data = frame.next(power_w, self._followed_c(heater))
        return self._link_of[heater].send(frame.identifier, frame.is_extended, data, frame.is_fd)

    def _followed_c(self, heater: str) -> float | None:
        """Return the valid temperature that a set-point follows [deg C], None without one."""
        follows = self.frames[heater].follows
        return None if follows is None else self._valid(
            reading_of(FOLLOWED, heater), follows, self._map.valid_for_s[TEMPERATURE])

    def on_frame(self, bus: int, identifier: int, is_extended: bool, data: bytes, age_s: float) -> None:
        """Take a frame of a bus in that arrived some seconds ago."""
        self._decoder.take(identifier, is_extended, data, self._clock_s() - age_s, self._readings, bus)
