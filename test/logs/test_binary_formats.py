# SPDX-License-Identifier: Apache-2.0
"""CAN frames with a DBC, MDF files and recorded topics, written by the packages' own writers."""

from logs_written import assert_same, drive, START_S, write_mcap
import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.logs.raw_log import Remarks
from bev_preheat.logs.reading import read_recording
from bev_preheat.logs.ros_bag import known_types, RosBag

DBC = """VERSION ""
NS_ :
BS_:
BU_: BMS
BO_ 341 BMS_State: 8 BMS
 SG_ PackVoltage : 0|16@1+ (0.01,0) [0|600] "V" BMS
 SG_ PackCurrent : 16|16@1- (0.01,0) [-300|300] "A" BMS
 SG_ SOC : 32|16@1+ (0.01,0) [0|100] "%" BMS
 SG_ BattTempAvg : 48|16@1+ (0.01,-40) [-40|80] "degC" BMS

BO_ 500 VCU_Drive: 4 BMS
 SG_ VehicleSpeed : 0|16@1+ (0.01,0) [0|250] "km/h" BMS
 SG_ AmbientTemperature : 16|8@1+ (0.5,-40) [-40|80] "degC" BMS
"""


def write_frames(path, log, writer):
    import can
    import cantools
    database = cantools.database.load_string(DBC, 'dbc')
    with writer(str(path)) as file:
        for at, second in enumerate(log['time_s']):
            for identifier, values in ((341, {
                    'PackVoltage': log['voltage_v'][at], 'PackCurrent': log['current_a'][at],
                    'SOC': 100.0 * log['soc'][at], 'BattTempAvg': log['battery_temperature_c'][at]}), (500, {
                        'VehicleSpeed': 3.6 * log['speed_mps'][at], 'AmbientTemperature': log['ambient_c'][at]})):
                file.on_message_received(can.Message(
                    timestamp=START_S + second, arbitration_id=identifier, is_extended_id=False,
                    data=database.encode_message(identifier, values)))


SIGNALS = ('voltage_v', 'current_a', 'soc', 'battery_temperature_c', 'speed_mps', 'ambient_c')


@pytest.mark.parametrize('writer, name, kind', [
    ('CanutilsLogWriter', 'a.log', 'candump'), ('ASCWriter', 'a.asc', 'ASC'), ('BLFWriter', 'a.blf', 'BLF')])
@pytest.mark.needs('can', 'cantools')
def test_can_frames(tmp_path, writer, name, kind):
    import can
    log = drive(60.0)
    path = tmp_path / name
    write_frames(path, log, getattr(can, writer))
    with pytest.raises(InvalidInput, match='need a DBC: name it in a signal map'):
        read_recording(path)
    (tmp_path / 'a.dbc').write_text(DBC, encoding='utf-8')
    recording = read_recording(path)
    assert recording.format == f'CAN frames ({kind})'
    # Half of the last bit.
    assert_same(recording, log, SIGNALS, rtol=1e-4, atol=0.006)
    assert recording.start_s == pytest.approx(START_S, abs=1.0)
    # The same by a map in another folder.
    (tmp_path / 'maps').mkdir()
    (tmp_path / 'a.dbc').rename(tmp_path / 'maps' / 'car.dbc')
    signals = tmp_path / 'maps' / 'car.yaml'
    signals.write_text('dbc: car.dbc\nsignals: {soc: BMS_State.SOC}\n', encoding='utf-8')
    assert_same(read_recording(path, signals), log, ['soc'], rtol=1e-4, atol=0.006)


@pytest.mark.needs('asammdf', 'can', 'cantools')
def test_frames_in_mdf_are_decoded_by_the_dbc_beside(tmp_path):
    import can
    log = drive(60.0)
    path = tmp_path / 'a.mf4'
    write_frames(path, log, can.MF4Writer)
    with pytest.raises(InvalidInput, match='CAN frames .MDF. need a DBC: name it in a signal map'):
        read_recording(path)
    (tmp_path / 'a.dbc').write_text(DBC, encoding='utf-8')
    assert_same(read_recording(path), log, SIGNALS, rtol=1e-4, atol=0.006)


@pytest.mark.needs('asammdf', 'can', 'cantools')
def test_frames_in_mdf_have_no_readings_beyond_those_of_j1939_nor_of_overlapping_signals(tmp_path):
    import can
    path = tmp_path / 'a.mf4'
    # 2566869235 is 0x98FF50F3.
    dbc = """VERSION ""
BU_: BMS
BO_ 2566869235 BMS: 8 BMS
 SG_ BattTemp : 0|8@1+ (0.5,-40) [0|0] "degC" BMS
 SG_ SOC : 8|8@1+ (0.4,0) [0|0] "%" BMS
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "J1939PG";
"""
    path.with_suffix('.dbc').write_text(dbc)
    writer = can.MF4Writer(path)
    for at in range(20):
        writer(can.Message(1.7e9 + at, 0x18FF50F3, True, data=[254 if at == 4 else 100 + at, 200, *[0] * 6]))
    writer.stop()
    recording = read_recording(path)
    np.testing.assert_allclose(recording.signals['battery_temperature_c'].value,
                               [10.0 + 0.5 * at for at in range(20) if at != 4])
    said = "record 5: BattTemp: 87 means 'error or not available (J1939)'; it is dropped"
    assert f'{path}, {said}' in recording.remarks
    path.with_suffix('.dbc').write_text(dbc.replace('8|8@1', '4|8@1'))
    with pytest.raises(InvalidInput, match=r'BMS: BattTemp and SOC overlap in the DBC \(bits 4, 5, 6, 7\)'):
        read_recording(path)


@pytest.mark.needs('asammdf')
def test_mdf(tmp_path):
    from asammdf import MDF, Signal
    log = drive(60.0, 0.1)
    slow = slice(None, None, 10)
    file = MDF(version='4.10')
    file.append([Signal(log['current_a'], log['time_s'], name='HV_Battery_Current', unit='A'),
                 Signal(log['voltage_v'], log['time_s'], name='HV_Battery_Voltage', unit='V'),
                 Signal(3.6 * log['speed_mps'], log['time_s'], name='VehicleSpeed', unit='km/h')])
    file.append([Signal(100.0 * log['soc'][slow], log['time_s'][slow], name='BMS_SOC', unit='%'),
                 Signal(log['battery_temperature_c'][slow] + 273.15, log['time_s'][slow],
                        name='BMS_BatteryTemp', unit='K'),
                 Signal(log['ambient_c'][slow], log['time_s'][slow], name='AmbientTemp', unit='degC')])
    path = tmp_path / 'a.mf4'
    file.save(path)
    file.close()
    recording = read_recording(path)
    assert recording.format == 'MDF'
    assert_same(recording, log, SIGNALS, rtol=1e-4, atol=1e-6)
    assert len(recording.signals['soc'].value) == 61


@pytest.mark.needs('rosbags', 'mcap')
def test_files_of_a_long_recording_are_read_in_their_order(tmp_path):
    (tmp_path / 'metadata.yaml').write_text('')
    for number in range(12):
        write_mcap(tmp_path / f'drive_{number}.mcap', '/speed_kmh', {
            at + 1: 0.36 * at for at in range(10 * number, 10 * number + 10)})
    signals = tmp_path / 'own.yaml'
    signals.write_text('signals: {speed_mps: {channels: /speed_kmh.data, unit: km/h}}')
    speed = read_recording(tmp_path, signals).signals['speed_mps']
    np.testing.assert_allclose(speed.value, 0.1 * np.arange(120))


@pytest.mark.parametrize('storage', ['MCAP', 'SQLITE3'])
@pytest.mark.needs('rosbags', 'mcap')
def test_recorded_topics(tmp_path, storage):
    """Simulated time runs twenty times as fast as the recorder's clock; the stamps count."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import get_typestore, Stores
    store = get_typestore(Stores.ROS2_JAZZY)
    state, header, stamp = (store.types[name] for name in (
        'sensor_msgs/msg/BatteryState', 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time'))
    log, empty = drive(60.0), np.zeros(0, np.float32)
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin[storage]) as file:
        topic = file.add_connection('/battery_state', state.__msgtype__, typestore=store)
        for at, second in enumerate(log['time_s']):
            # sensor_msgs has positive for charging.
            message = state(header(stamp(1000 + int(second), 0), ''), log['voltage_v'][at],
                            log['battery_temperature_c'][at], -log['current_a'][at], 0.0, 0.0, 0.0, log['soc'][at],
                            0, 0, 0, True, empty, empty, '', '')
            received_ns = int((START_S + second / 20.0) * 1e9)
            file.write(topic, received_ns, store.serialize_cdr(message, state.__msgtype__))
    for path in (tmp_path / 'bag', next((tmp_path / 'bag').glob('bag.*'))):
        recording = read_recording(path)
        assert (recording.format, recording.signal_map, recording.start_s) == ('ROS 2 topics', 'topics', 1000.0)
        assert_same(recording, log, SIGNALS[:4], rtol=1e-4, atol=1e-6)


@pytest.mark.needs('rosbags', 'mcap')
def test_of_two_batteries_in_one_recording_the_other_is_named(tmp_path):
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import get_typestore, Stores
    store = get_typestore(Stores.ROS2_JAZZY)
    state, header, stamp = (store.types[name] for name in (
        'sensor_msgs/msg/BatteryState', 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time'))
    empty = np.zeros(0, np.float32)
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as file:
        topics = [file.add_connection(f'/car_{number}/battery_state', state.__msgtype__, typestore=store)
                  for number in (7, 8)]
        for second in range(30):
            for topic, temperature_c in zip(topics, (5.0, 25.0)):
                message = state(header(stamp(1000 + second, 0), ''), 360.0, temperature_c, -30.0, 0.0, 0.0, 0.0,
                                0.8, 0, 0, 0, True, empty, empty, '', '')
                file.write(topic, second * 10**9, store.serialize_cdr(message, state.__msgtype__))
    recording = read_recording(tmp_path / 'bag')
    assert set(recording.signals['battery_temperature_c'].value) == {5.0}
    [remark] = [each for each in recording.remarks if '/car_8/' in each]
    assert remark.endswith('/car_7/battery_state.temperature counts for battery_temperature_c, '
                           '/car_8/battery_state.temperature does not; to read that, name it in a signal map '
                           '(and 3 more signals)')


@pytest.mark.parametrize('power_w', [0.0, 1800.0])
@pytest.mark.needs('rosbags', 'mcap')
def test_heat_of_other_sources_in_a_recording_is_named(tmp_path, power_w):
    from rosbags.rosbag2 import StoragePlugin, Writer
    store = known_types()
    header, stamp, temperature, command = (store.types[name] for name in (
        'std_msgs/msg/Header', 'builtin_interfaces/msg/Time', 'sensor_msgs/msg/Temperature',
        'bev_preheat_msgs/msg/HeatSourceCommand'))
    signals = tmp_path / 'own.yaml'
    signals.write_text('signals: {battery_temperature_c: /pack.temperature}')
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as file:
        topics = {kind: file.add_connection(name, kind.__msgtype__, typestore=store) for kind, name in (
            (temperature, '/pack'), (command, '/car/heat_source_command'))}
        for second in range(20):
            head = header(stamp(1000 + second, 0), '')
            for message in (temperature(head, 5.0 + 0.01 * second, 0.0),
                            command(head, 'heat_pump', power_w * (second > 9), stamp(1002 + second, 0), 1)):
                file.write(topics[type(message)], second * 10**9,
                           store.serialize_cdr(message, message.__msgtype__))
    remarks = read_recording(tmp_path / 'bag', signals).remarks
    said = [remark for remark in remarks if 'heat_source_command' in remark]
    assert len(said) == (power_w > 0.0)
    assert all('up to 1800 W; no signal has their heat or cold, so predictions leave it out' in each
               for each in said)


@pytest.mark.needs('rosbags', 'mcap')
def test_the_latest_route_tells_what_the_planners_recording_does_not(tmp_path):
    from rosbags.interfaces import Nodetype
    from rosbags.rosbag2 import StoragePlugin, Writer
    store, nothing = known_types(), np.zeros(0)
    header, stamp, route, temperature = (store.types[name] for name in (
        'std_msgs/msg/Header', 'builtin_interfaces/msg/Time', 'bev_preheat_msgs/msg/RoutePlan',
        'sensor_msgs/msg/Temperature'))
    fields = {name: '' if name == 'route_id' else 0.0 if kind[0] == Nodetype.BASE else nothing
              for name, kind in store.fielddefs[route.__msgtype__][1]}

    def planned(begin_s, durations_s, speeds_mps, stop_after=()):
        return route(**{**fields, 'header': header(stamp(begin_s, 0), ''), 'charging_planned': True,
                        'has_target_battery_temperature': False, 'segment_duration': np.array(durations_s),
                        'speed': np.array(speeds_mps), 'ambient_temperature': np.array([-4.0]),
                        'stop_after_segment': np.array(stop_after, np.uint32),
                        'stop_duration': np.full(len(stop_after), 20.0)})

    # The drive begins in the past; the second plan has a slower end, behind a stop.
    plans = {2: planned(990, [15.0, 30.0, 30.0], [9.0, 21.0, 33.0]), 40: planned(
        990, [15.0, 40.0, 10.0], [9.0, 21.0, 13.0], [1])}
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as file:
        topics = {kind: file.add_connection(name, kind.__msgtype__, typestore=store) for name, kind in (
            ('/route_plan', route), ('/battery_state', temperature))}
        for second in range(100):
            messages = [temperature(header(stamp(1000 + second, 0), ''), 5.0, 0.0)]
            for message in [*([plans[second]] if second in plans else []), *messages]:
                file.write(topics[type(message)], second * 10**9,
                           store.serialize_cdr(message, message.__msgtype__))
    recording = read_recording(tmp_path / 'bag')
    speed, ambient = recording.signals['speed_mps'], recording.signals['ambient_c']
    assert list(zip(speed.time_s.tolist(), speed.value.tolist())) == [
        (2.0, 9.0), (5.0, 21.0), (35.0, 33.0), (40.0, 21.0), (45.0, 0.0), (65.0, 13.0), (75.0, 0.0)]
    assert set(ambient.value.tolist()) == {-4.0}


@pytest.mark.parametrize('storage', ['MCAP', 'SQLITE3'])
@pytest.mark.needs('rosbags', 'mcap', 'rclpy')
def test_recorded_routes(tmp_path, storage):
    """The bytes that rclpy makes of empty sequences have a meaningless end of up to 60 bytes."""
    from array import array

    from rclpy.serialization import serialize_message
    from rosbags.rosbag2 import StoragePlugin, Writer

    from bev_preheat_msgs.msg import RoutePlan
    ends = set()
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin[storage]) as file:
        store = known_types()
        topic = file.add_connection('/route_plan', 'bev_preheat_msgs/msg/RoutePlan', typestore=store)
        for number in range(24):
            message = RoutePlan(
                route_id='x' * (number % 5), segment_duration=array('d', [30.0] * (number % 3)),
                stop_has_target_battery_temperature=[True] * (number % 4), standing_time=7.0 * number,
                stop_after_segment=array('I', range(number % 2)), charging_departure_soc=0.01 * number,
                departure_soc=array('d', [0.5] * (1 + number % 2)))
            message.header.frame_id = 'y' * (number % 7)
            data = bytes(serialize_message(message))
            kind = store.get_msgdef(topic.msgtype)
            ends.add(len(data) - 4 - kind.deserialize_cdr_le(data[4:], 0, kind.cls, store)[1])
            file.write(topic, number * 10**9, data)
    # Otherwise this test shows nothing.
    assert max(ends) > 3
    for path in (tmp_path / 'bag', next((tmp_path / 'bag').glob('bag.*'))):
        bag = RosBag(path)
        names = [f'/route_plan.{field}' for field in (
            'standing_time', 'charging_departure_soc', 'departure_soc.0')]
        assert {*names} <= {channel.name for channel in bag.channels}
        pieces = {piece.channel: piece for piece in bag.pieces(names, Remarks())}
        np.testing.assert_array_equal(pieces[names[0]].values, 7.0 * np.arange(24))
        np.testing.assert_allclose(pieces[names[1]].values, 0.01 * np.arange(24))
        np.testing.assert_array_equal(pieces[names[2]].values, np.full(24, 0.5))
