# SPDX-License-Identifier: Apache-2.0
"""A live CAN bus under attack, through an adapter on a pseudo terminal: no wrong reading is used, all recover."""

from contextlib import closing, contextmanager
from queue import Empty, Queue
import re
import time
from types import SimpleNamespace

from example_frames import can_map, COMMAND, read_command, STATUS, status_frame, temperature_frame, TEMPERATURES
import pytest
from slcan_port import SlcanPort
from waiting import poll_until

from bev_preheat.bus.can_source import CanLink, CanSource
from bev_preheat.bus.live_map import load_live_map
from bev_preheat.bus.source import age_of_stamp, steady_s

pytestmark = [pytest.mark.needs('cantools', 'can', 'crccheck', 'serial')]


@contextmanager
def started(source, port=None):
    """Give a source that listens, on an adapter's port if given, and close it."""
    with closing(source):
        source.start()
        poll_until(lambda: (port is None or b'O' in port.commands) and not source.problem, 'an open bus')
        yield source


class Car:
    """The car on the adapter's bus and the source that listens, with a clock that the test sets."""

    def __init__(self, folder, port):
        self.port, self.now_s = port, 1000.0
        self.source = CanSource(load_live_map(can_map(folder, port.path)), lambda: self.now_s)
        self._counts = {STATUS: 0, TEMPERATURES: 0}
        self._sent = 0

    def send(self, *frames):
        """Send frames, and wait until they have been taken."""
        for identifier, data in frames:
            self.port.send(identifier, data)
        self._sent += len(frames)
        poll_until(lambda: int(self.source.figures()['frames']) >= self._sent, f'{self._sent} frames')

    def status(self, soc=0.5, **changed):
        self._counts[STATUS] = (self._counts[STATUS] + 1) % 16
        return STATUS, status_frame(soc, 360.0, 55.5, **{'count': self._counts[STATUS], **changed})

    def temperatures(self, mean_c=-7.3, **changed):
        self._counts[TEMPERATURES] = (self._counts[TEMPERATURES] + 1) % 16
        usual = {'count': self._counts[TEMPERATURES], 'low_c': mean_c - 1.5, 'high_c': mean_c + 1.0}
        return TEMPERATURES, temperature_frame(mean_c, **{**usual, **changed})

    def battery(self):
        return self.source.battery(self.now_s)

    def doubts(self):
        return ' '.join(self.source.doubts().values())


@pytest.fixture
def car(tmp_path):
    with closing(SlcanPort()) as port:
        car = Car(tmp_path, port)
        with started(car.source, port):
            yield car


def test_frames_packed_bit_by_bit_become_the_battery(car):
    assert car.battery()[0] is None
    car.send(car.status(soc=0.637, charging=True), car.temperatures())
    car.now_s += 0.5
    battery, lacking = car.battery()
    assert not lacking and not battery.missing
    assert battery.temperature_c == pytest.approx(-7.3)
    assert (battery.soc, battery.voltage_v, battery.current_a) == pytest.approx((0.637, 360.0, 55.5))
    assert battery.cells_c == pytest.approx((-8.8, -6.3))
    assert battery.is_charging is True
    assert battery.instant_s == pytest.approx(1000.0, abs=0.2)


def changed(frame, at, bits):
    """Return a frame with these bits of a byte changed."""
    identifier, data = frame
    return identifier, bytes(byte ^ bits * (number == at) for number, byte in enumerate(data))


@pytest.mark.parametrize('attack, reason', [
    (lambda car: [car.temperatures(20.0, count=1)] * 2, 'counter BMS_TempAlive has stayed at 1'),
    (lambda car: [changed(car.temperatures(20.0), 7, 1)], 'BMS_TempCrc is 0x'),
    (lambda car: [changed(car.temperatures(20.0), 0, 4)], 'but the checksum of the data is 0x'),
    (lambda car: [(TEMPERATURES, car.temperatures(20.0)[1][:5])], 'a frame of 5 bytes; the DBC has 8'),
    # 2047 on the bus, which the DBC calls SNA, is 154.7 deg C.
    (lambda car: [car.temperatures(154.7)], 'BMS_TempMean'),
    (lambda car: [car.temperatures(120.0)], 'outside the limits of the DBC')],
    ids=['counter', 'checksum', 'bit', 'short', 'no reading', 'limits'])
def test_frames_in_doubt_are_dropped_with_the_reason_and_the_reading_expires(car, attack, reason):
    car.send(car.status(), car.temperatures(count=1))
    frames = attack(car)
    car.now_s += 1.0
    car.send(car.status(), *frames)
    assert car.battery()[0].temperature_c == pytest.approx(-7.3)
    assert reason in car.doubts()
    car.now_s += 1.5
    car.send(car.status(), *attack(car))
    battery, lacking = car.battery()
    assert battery is None
    # The time of the socket passes, too.
    assert [re.sub(r'2\.5\d', '2.5', each) for each in lacking] == [
        'battery_temperature_c: the last valid reading of BMS_Temperatures.BMS_TempMean is 2.5 s old; it expires '
        'after 2 s']
    car.send(car.temperatures(-5.0, count=7))
    assert car.battery()[0].temperature_c == pytest.approx(-5.0)


def test_ten_times_the_rate_is_refused_until_it_is_over(car):
    car.send(car.status())
    for _ in range(40):
        car.now_s += 0.05
        car.send(car.temperatures(20.0))
    assert 'is there a second sender?' in car.doubts()
    assert 'cycle time of 0.5 s allows 7 in 1 s' in car.doubts()
    car.now_s += 2.0
    car.send(car.status(), car.temperatures(-7.3))
    assert car.battery()[0].temperature_c == pytest.approx(-7.3)


def test_frames_from_before_the_bus_was_opened_are_not_used(tmp_path):
    with closing(SlcanPort()) as port:
        for count in range(8):
            port.send(STATUS, status_frame(0.5, 360.0, 0.0, count))
            port.send(TEMPERATURES, temperature_frame(20.0, count))
        with started(CanSource(load_live_map(can_map(tmp_path, port.path)), steady_s), port) as source:
            port.send(STATUS, status_frame(0.5, 360.0, 0.0, 9))
            poll_until(lambda: int(source.figures()['frames']) >= 1, 'the new frame')
            assert source.battery(steady_s()) == (None, (
                'battery_temperature_c: no valid reading of BMS_Temperatures.BMS_TempMean yet',))


def test_bytes_that_are_no_frames_do_not_end_the_reception(car):
    car.send(car.status(), car.temperatures())
    for garbage in (b'\x00\xff' * 40 + b'\r', b't3A1\r', b'tZZZ8\r', b't3A19\r', b't3A18GGGG\r', b'\r\r', b'\x07'):
        car.port.send_text(garbage)

    def is_heard_again():
        car.now_s += 0.5
        for frame in (car.status(), car.temperatures(-4.0)):
            car.port.send(*frame)
        battery = car.battery()[0]
        return battery is not None and battery.temperature_c == pytest.approx(-4.0)

    # The link may have to open the adapter again, which takes a second.
    poll_until(is_heard_again, 'the battery')


def test_speed_and_air_are_values_of_their_own_that_expire(tmp_path):
    with closing(SlcanPort()) as port:
        file, now_s = can_map(tmp_path, port.path), 1000.0
        # Any signals will do.
        file.write_text(file.read_text().replace(
            '  soc:', '  speed_mps: {channels: BMS_Status.BMS_SoC, unit: km/h}\n'
            '  ambient_c: BMS_Temperatures.BMS_TempMin\n  soc:'))
        with started(CanSource(load_live_map(file), lambda: now_s), port) as source:
            assert source.value('speed_mps', now_s) is None
            port.send(STATUS, status_frame(0.72, 360.0, 0.0, 1))
            port.send(TEMPERATURES, temperature_frame(-2.0, 1, low_c=-5.5))
            poll_until(lambda: int(source.figures()['frames']) == 2, 'both frames')
            assert source.value('speed_mps', now_s + 1.9) == pytest.approx(20.0)
            assert source.value('speed_mps', now_s + 2.1) is None
            # The air changes slowly.
            assert source.value('ambient_c', now_s + 3600.0) == pytest.approx(-5.5)
            assert source.value('ambient_c', now_s + 6.1 * 3600.0) is None


def test_the_commands_frame_has_power_counter_and_checksum(car):
    for power_w in (3456.0, 7000.0, 99999.0, 0.0):
        assert car.source.send_power(power_w) == ''
    poll_until(lambda: len(car.port.frames) >= 4, 'four frames')
    read = [read_command(data) for _, identifier, data in car.port.frames if identifier == COMMAND]
    # In steps of 10 W, rounded down.
    assert [power_w for power_w, *_ in read] == [3450.0, 7000.0, 7000.0, 0.0]
    assert [enabled for _, enabled, *_ in read] == [True, True, True, False]
    counts = [count for *_, count, _ in read]
    assert [(after - before) % 16 for before, after in zip(counts, counts[1:])] == [1, 1, 1]
    assert all(right for *_, right in read)


def test_a_controller_that_is_off_is_a_problem_until_a_frame_comes(monkeypatch):
    arriving = Queue()

    def receive(timeout):
        try:
            return arriving.get(timeout=timeout)
        except Empty:
            return None

    # A bus of python-can.
    bus = SimpleNamespace(recv=receive, shutdown=lambda: None)
    monkeypatch.setattr('can.Bus', lambda **settings: bus)
    live_map = load_live_map('example_car')
    link = CanLink(live_map.can[0], [(STATUS, False)], lambda *frame: None)
    link.start()
    poll_until(lambda: not link.problem, 'an open bus')
    bus_off = SimpleNamespace(is_error_frame=True, arbitration_id=0x40)
    frame = SimpleNamespace(is_error_frame=False, is_remote_frame=False, is_rx=True, arbitration_id=STATUS,
                            is_extended_id=False, data=b'', timestamp=0.0)
    # Again and again: on a busy computer a stalled thread drops the queued frames.
    poll_until(lambda: arriving.put(bus_off) or link.problem.startswith('bus off: '), 'bus off')
    # No more error frames are under way.
    poll_until(arriving.empty, 'an empty queue')
    assert 'bus off' in link.send(COMMAND, False, b'\x00')
    poll_until(lambda: arriving.put(frame) or not link.problem, 'the end of the problem')
    link.close()


def test_steps_of_the_systems_clock_change_no_age(monkeypatch):
    before_s = steady_s()
    monkeypatch.setattr(time, 'time', lambda: 0.0)
    assert 0.0 <= steady_s() - before_s < 1.0
    monkeypatch.setattr(time, 'time', lambda: 1e9)
    # Stamps of the future, of more than an hour ago and of an adapter's own clock have no age.
    assert [age_of_stamp(stamp_s) for stamp_s in (1e9 + 5.0, 1e9 - 4000.0, 12.5, None)] == [0.0] * 4
    assert age_of_stamp(1e9 - 0.75) == 0.75


def test_readings_are_dropped_when_the_clock_falls_back(car):
    car.send(car.status(), car.temperatures())
    car.source.forget()
    assert car.battery()[0] is None


def test_frames_of_29_bits_with_the_same_number_are_not_used():
    source = CanSource(load_live_map('example_car'), lambda: 0.0)
    source.on_frame(0, STATUS, True, status_frame(0.5, 360.0, 0.0, 1), 0.0)
    assert source.value('soc', 0.0) is None
    source.on_frame(0, STATUS, False, status_frame(0.5, 360.0, 0.0, 1), 0.0)
    assert source.value('soc', 0.0) == pytest.approx(0.5)


def test_an_adapter_that_is_unplugged_is_opened_again_when_it_is_back(tmp_path):
    """The name of the port stays, as by udev: a link that leads to another terminal after the return."""
    link_path = tmp_path / 'ttyCAN'
    first, second = SlcanPort(), SlcanPort()
    link_path.symlink_to(first.path)
    with closing(second), started(
            CanSource(load_live_map(can_map(tmp_path, link_path)), steady_s), first) as source:
        link_path.unlink()
        first.close()
        poll_until(lambda: 'No such file or directory' in source.problem, 'the adapter is missed')
        assert source.send_power(1000.0)
        link_path.symlink_to(second.path)
        poll_until(lambda: not source.problem, 'the adapter is back')
        second.send(STATUS, status_frame(0.5, 360.0, 0.0, 3))
        second.send(TEMPERATURES, temperature_frame(-2.0, 3))
        battery = poll_until(lambda: source.battery(steady_s())[0], 'the battery')
        assert battery.temperature_c == pytest.approx(-2.0)
        assert source.figures()['reconnects'] == '1'


def recorded_frames(instant_s):
    """Return (instant [s], identifier, data) of a second of the car; the last frame has a wrong checksum."""
    frames = []
    for step in range(10):
        frames.append((instant_s + 0.1 * step, STATUS, status_frame(0.61, 360.0, 40.0, step)))
        if step % 5 == 0:
            data = temperature_frame(-6.0 + step / 5, step // 5)
            frames.append((instant_s + 0.1 * step + 0.01, TEMPERATURES, data))
    return [*frames, (instant_s + 0.95, *changed((TEMPERATURES, temperature_frame(30.0, 2)), 7, 1))]


@pytest.mark.parametrize('suffix', ['log', 'asc', 'blf'])
def test_recording_is_played_at_its_pace_and_expires(tmp_path, suffix):
    import can
    recording = tmp_path / f'drive.{suffix}'
    if suffix == 'log':
        recording.write_text(''.join(f'({at_s:.6f}) can0 {identifier:03X}#{data.hex().upper()}\n'
                                     for at_s, identifier, data in recorded_frames(1768460400.0)))
    else:
        with can.Logger(str(recording)) as writer:
            for at_s, identifier, data in recorded_frames(1768460400.0):
                writer.on_message_received(can.Message(
                    timestamp=at_s, arbitration_id=identifier, is_extended_id=False, data=data))
    begun_s = steady_s()
    with started(CanSource(load_live_map(can_map(tmp_path, recording.name, 'replay', None)), steady_s)) as source:
        first = poll_until(lambda: source.battery(steady_s())[0], 'the first battery')
        assert (first.temperature_c, first.soc) == pytest.approx((-6.0, 0.61))
        poll_until(lambda: int(source.figures()['frames']) == 13, 'all frames')
        assert 0.9 < steady_s() - begun_s < 3.0
        now_s = steady_s()
        battery = source.battery(now_s)[0]
        # The last temperature is refused; the one before counts, with its own instant.
        assert battery.temperature_c == pytest.approx(-5.0)
        assert 0.3 < now_s - battery.instant_s < 2.0
        assert 'BMS_TempCrc is 0x' in ' '.join(source.doubts().values())
        # Frames that are sent go nowhere; after the end the readings expire.
        assert source.send_power(1000.0) == ''
        assert source.battery(now_s + 2.0)[0] is None
