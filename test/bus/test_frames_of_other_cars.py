# SPDX-License-Identifier: Apache-2.0
"""Heaters commanded by share or set-point, E2E profiles, cells with gaps, two buses, messages on maps."""

from contextlib import closing

import pytest
from refusals import problems_of
from waiting import poll_until

from bev_preheat.bus.can_decoder import BusMessages, CanDecoder
from bev_preheat.bus.can_source import CanSource
from bev_preheat.bus.heater_frame import HeaterFrame
from bev_preheat.bus.live_map import load_live_map
from bev_preheat.bus.source import Readings, steady_s
from bev_preheat.logs.reading import read_recording
from bev_preheat.vehicle.description import HVCH

pytestmark = [pytest.mark.needs('cantools', 'can', 'crccheck')]
NS = 'VERSION ""\nBU_: CAR GW\n'
BATTERY = NS + """BO_ 256 BMS: 8 CAR
 SG_ Temp : 0|16@1- (0.01,0) [-60|100] "degC" GW
 SG_ Soc : 16|8@1+ (0.5,0) [0|100] "%" GW
BO_ 257 Cells: 8 CAR
""" + ''.join(f' SG_ T{n} : {8 * n - 8}|8@1+ (1,-50) [-50|100] "degC" GW\n' for n in range(1, 9))
HEATER = """BO_ 512 Heater: 8 GW
 SG_ Share : 0|8@1+ (0.5,0) [0|100] "%" CAR
 SG_ Power : 8|8@1+ (0.1,0) [0|10] "kW" CAR
 SG_ SetPoint : 16|8@1+ (0.5,-20) [-20|90] "degC" CAR
 SG_ Plain : 24|8@1+ (50,0) [0|7000] "" CAR
 SG_ Current : 32|8@1+ (1,0) [0|250] "A" CAR
 SG_ Enable : 40|1@1+ (1,0) [0|1] "" CAR
 SG_ Count : 44|4@1+ (1,0) [0|15] "" CAR
BO_ 513 HeaterState: 8 CAR
 SG_ Share : 0|8@1+ (0.5,0) [0|100] "%" GW
 SG_ Inlet : 8|8@1+ (0.5,-40) [-40|87.5] "degC" GW
"""
MAP = """dbc: car.dbc
signals: {{battery_temperature_c: BMS.Temp, soc: BMS.Soc{signals}}}
live:
  can: {{interface: virtual, channel: {channel}}}
{live}
"""


def written_map(folder, live='', dbc=BATTERY + HEATER, signals=''):
    """Write a map and its DBC; the bus has the folder's name, so that each test has its own."""
    (folder / 'car.dbc').write_text(dbc)
    (folder / 'car.yaml').write_text(MAP.format(channel=folder.name, live=live, signals=signals))
    return folder / 'car.yaml'


def heater_frame(folder, command, vehicle_power_w=None, dbc=BATTERY + HEATER, counter='counter: Count, '):
    live_map = load_live_map(written_map(
        folder, f'  heater_command: {{message: Heater, {counter}{command}}}', dbc))
    return HeaterFrame(live_map.heaters[HVCH].command, BusMessages(live_map).by_name, str(live_map.signals.path),
                       vehicle_power_w)


# --- The contents of the command ---


@pytest.mark.parametrize('name, counts', [('Heater_AliveCounter', [0, 1, 2]), ('Stage', [0, 0, 0])])
def test_a_map_without_a_counter_counts_by_the_signals_name_or_not_at_all(tmp_path, name, counts):
    dbc = (BATTERY + HEATER).replace('SG_ Count', f'SG_ {name}')
    frame = heater_frame(tmp_path, 'power: Power', dbc=dbc, counter='')
    frames = [frame.next(1000.0) for _ in counts]
    assert [data[1] for data in frames] == [10, 10, 10]
    assert [(data[5] >> 4) - (frames[0][5] >> 4) for data in frames] == counts


@pytest.mark.parametrize('command, vehicle_w, byte, expected', [
    # Raw values by hand: half per cent, tenths of a kilowatt, 50 W.
    ('power: Share, full_power_w: 5000', None, 0, {0: 0, 24: 0, 25: 1, 2500: 100, 4999: 199, 5000: 200, 9e9: 200}),
    ('power: Share', 7000.0, 0, {0: 0, 3500: 100, 7000: 200}),
    ('power: Share, full_power_w: 5000, maximum_power_w: 3000', None, 0, {4000: 120}),
    ('power: Power', None, 1, {0: 0, 99: 0, 100: 1, 3456: 34, 99999: 100}),
    ('power: Plain, unit: W', None, 3, {0: 0, 49: 0, 3456: 69}),
], ids=['share of the map', "share of the vehicle's power", 'limited share', 'kilowatts', 'unit of the map'])
def test_power_and_share_are_never_above_the_command(tmp_path, command, vehicle_w, byte, expected):
    frame = heater_frame(tmp_path, f'{command}, enable: Enable', vehicle_w)
    for power_w, raw in expected.items():
        data = frame.next(power_w)
        assert (data[byte], data[5] & 1) == (raw, raw > 0), power_w


def test_command_never_carries_a_value_that_means_none(tmp_path):
    dbc = BATTERY + HEATER.replace('Plain : 24|8@1+ (50,0) [0|7000] ""', 'Plain : 24|7@1+ (50,0) [0|0] "W"')
    frame = heater_frame(tmp_path, 'power: Plain', dbc=dbc + 'VAL_ 512 Plain 127 "SNA" 126 "Init";\n')
    assert (frame.highest_w, frame.next(7000.0)[3]) == (6250.0, 125)


@pytest.mark.parametrize('cycle_ms, period_s', [(0, 0.1), (2, 0.01), (500, 0.5), (5000, 1.0)])
def test_command_is_sent_at_the_cycle_of_the_dbc_but_at_least_each_second(tmp_path, cycle_ms, period_s):
    # Its lease of 2.5 s would be over for up to 5 s before a frame says so.
    cycle = f'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;\nBA_ "GenMsgCycleTime" BO_ 512 {cycle_ms};\n'
    assert heater_frame(tmp_path, 'power: Power', dbc=BATTERY + HEATER + cycle).period_s == period_s


COOLANT = 'power: SetPoint, maximum_power_w: 5000, coolant: {follows: HeaterState.Inlet, watts_per_kelvin: 200, ' \
          'range_c: [5, 60]}'


@pytest.mark.parametrize('power_w, inlet_c, set_point_c', [
    # Inlet + power / 200 W/K, rounded down to half a kelvin, at most 60 degC and the heater's 5000 W.
    (2000.0, 10.0, 20.0), (2010.0, 10.0, 20.0), (2100.0, 10.0, 20.5), (9e9, 10.0, 35.0), (4000.0, 55.0, 60.0),
    # 0 W, an unknown inlet, a set-point below the range, a difference rounded to 0: off.
    (0.0, 10.0, None), (-5.0, 10.0, None), (2000.0, None, None), (2000.0, float('nan'), None),
    (1000.0, -10.0, None), (90.0, 10.0, None), (1000.0, 65.0, None)])
@pytest.mark.parametrize('off, off_raw', [('off_value: -20', 0), ('enable: Enable', 50)])
def test_set_point_follows_the_coolant_and_is_off_in_doubt(tmp_path, power_w, inlet_c, set_point_c, off, off_raw):
    data = heater_frame(tmp_path, f'{COOLANT}, {off}').next(power_w, inlet_c)
    assert data[2] == (off_raw if set_point_c is None else 2 * (set_point_c + 20.0))
    if 'enable' in off:
        assert data[5] & 1 == (set_point_c is not None)


def test_heater_is_at_fault_without_the_temperature_that_its_set_point_follows(tmp_path):
    now_s = [100.0]
    path = written_map(
        tmp_path, f'  heater_command: {{message: Heater, counter: Count, off_value: -20, {COOLANT}}}')
    source = CanSource(load_live_map(path), lambda: now_s[0])
    assert source.heater_status()[1] == 'no valid HeaterState.Inlet for 2 s, which the set-point follows'
    source.on_frame(0, 513, False, bytes([0, 100, 0, 0, 0, 0, 0, 0]), 0.0)
    now_s[0] = 101.9
    assert source.heater_status() == (None, '')
    now_s[0] = 102.1
    assert source.heater_status()[1]


# --- End-to-end protection ---


def crc(data, bits, polynomial, start, final):
    value = start
    for byte in data:
        value ^= byte << bits - 8
        for _ in range(8):
            value = (value << 1 ^ (polynomial if value >> bits - 1 else 0)) & (1 << bits) - 1
    return value ^ final


LIST = list(range(1, 17))
DBC_P11 = NS + """BO_ 512 Heater: 8 GW
 SG_ Crc : 0|8@1+ (1,0) [0|255] "" CAR
 SG_ Count : 8|4@1+ (1,0) [0|15] "" CAR
 SG_ Nibble : 12|4@1+ (1,0) [0|15] "" CAR
 SG_ Power : 16|8@1+ (100,0) [0|7000] "W" CAR
"""
DBC_P5 = NS + """BO_ 512 Heater: 8 GW
 SG_ Crc : 0|16@1+ (1,0) [0|65535] "" CAR
 SG_ Count : 16|8@1+ (1,0) [0|255] "" CAR
 SG_ Power : 24|8@1+ (100,0) [0|7000] "W" CAR
"""
DBC_P5_LONG = NS + """BO_ 512 Heater: 16 GW
 SG_ Power : 0|8@1+ (100,0) [0|7000] "W" CAR
 SG_ Crc : 64|16@1+ (1,0) [0|65535] "" CAR
 SG_ Count : 80|8@1+ (1,0) [0|255] "" CAR
"""
# The examples of AUTOSAR's E2E Protocol Specification for profiles 5 and 11, and their like for 1 and 2 as the
# library autosar-e2e 1.0 has them: data of zeros, counter 0, 1, 2.
VECTORS = [
    (DBC_P11, 'e2e_profile: 11, data_id: 0x123', 15, ['cc00', '9101', '7602']),
    (DBC_P11, 'e2e_profile: 11, data_id: 0x123, data_id_mode: nibble, data_id_nibble: Nibble', 15,
     ['2a10', '7711', '9012']),
    (DBC_P11, 'e2e_profile: 1, data_id: 0x123', 15, ['cc00', '9101', '7602']),
    (DBC_P11, 'e2e_profile: 1, data_id: 0x123, data_id_mode: alternating', 15, ['ce00', '0201', '7402']),
    (DBC_P11, 'e2e_profile: 1, data_id: 0x123, data_id_mode: low', 15, ['ce00', '9301', '7402']),
    (DBC_P11, f'e2e_profile: 2, data_ids: {LIST}', 16, ['0e00', '1b01', '9802']),
    (DBC_P11, f'e2e_profile: 22, data_ids: {LIST}', 16, ['0e00', '1b01', '9802']),
    (DBC_P5, 'e2e_profile: 5, data_id: 0x1234', 256, ['1cca00', 'cf8d01']),
    (DBC_P5_LONG, 'e2e_profile: 5, data_id: 0x1234', 256, ['0000000000000000289100'])]
IDS = ['11', '11 nibble', '1', '1 alternating', '1 low', '2', '22', '5', '5 at byte 8']


def protected(folder, dbc, protection):
    return heater_frame(folder, f'power: Power, checksum: {{signal: Crc, {protection}}}', dbc=dbc)


@pytest.mark.parametrize('dbc, protection, counts, beginnings', VECTORS, ids=IDS)
def test_sent_frames_have_the_published_protection(tmp_path, dbc, protection, counts, beginnings):
    frame = protected(tmp_path, dbc, protection)
    # The constructor made the frame with count 0: on to the end of the counter.
    for _ in range(counts - 1):
        frame.next(0.0)
    for beginning in beginnings:
        data = frame.next(0.0)
        assert data == bytes.fromhex(beginning).ljust(len(data), b'\0')


def receiver(folder, dbc, protection, counter='counter: Count, '):
    text = dbc
    for before, after in (('Heater', 'BMS'), ('"W"', '"degC"'), ('Power', 'Temp'), ('[0|7000]', '[0|80]'),
                          ('(100,0)', '(1,0)')):
        text = text.replace(before, after)
    path = written_map(folder, f'  required: [battery_temperature_c]\n  messages: {{BMS: {{{counter}checksum: '
                               f'{{signal: Crc, {protection}}}}}}}', text)
    live_map = load_live_map(path)
    return CanDecoder(live_map, BusMessages(live_map), {})


@pytest.mark.parametrize('dbc, protection, counts, _', VECTORS, ids=IDS)
def test_received_frames_are_checked_and_each_wrong_bit_is_found(tmp_path, dbc, protection, counts, _):
    (tmp_path / 'other').mkdir()
    frame, decoder = protected(tmp_path / 'other', dbc, protection), receiver(tmp_path, dbc, protection)
    for number in range(20):
        readings = Readings()
        data = frame.next(100.0 * (number + 1))
        decoder.take(512, False, data, float(number), readings)
        assert readings.latest('battery_temperature_c', 'BMS.Temp').value == number + 1
    for bit in range(8 * len(data)):
        readings = Readings()
        wrong = (int.from_bytes(data, 'big') ^ 1 << bit).to_bytes(len(data), 'big')
        decoder.take(512, False, wrong, 100.0 + bit, readings)
        assert readings.latest('battery_temperature_c', 'BMS.Temp') is None
        assert readings.doubts(100.0 + bit)


def test_plain_crc16_has_a_suffix_and_motorola_order(tmp_path):
    dbc = DBC_P5.replace('0|16@1+', '7|16@0+')
    decoder, readings = receiver(
        tmp_path, dbc, 'method: crc16_ccitt, suffix: [0x34, 0x12]', counter=''), Readings()
    body = bytes([5, 21, 0, 0, 0, 0])
    protection = crc(body + b'\x34\x12', 16, 0x1021, 0xFFFF, 0).to_bytes(2, 'big')
    decoder.take(512, False, protection + body, 0.0, readings)
    assert readings.latest('battery_temperature_c', 'BMS.Temp').value == 21.0


# --- Cells with gaps ---


@pytest.mark.parametrize('entry', ["'/^Cells\\.T\\d$/'", str([f'Cells.T{n}' for n in range(1, 9)])])
@pytest.mark.parametrize('combine', ['mean', 'min', 'max'])
@pytest.mark.parametrize('missing', [0, 1, 2, 3, 8])
def test_aggregate_holds_while_enough_cells_are_valid(tmp_path, entry, combine, missing):
    path = written_map(tmp_path)
    path.write_text(path.read_text().replace(
        'BMS.Temp', f'{{channels: {entry}, combine: {combine}, at_least: 6, no_reading: [77]}}'))
    source = CanSource(load_live_map(path), lambda: 100.0)
    cells_c = [10.0 + number for number in range(8)]
    raw = [round(cell_c + 50) if number >= missing else 127 for number, cell_c in enumerate(cells_c)]
    source.on_frame(0, 256, False, bytes([0, 0, 160, 0, 0, 0, 0, 0]), 0.0)
    source.on_frame(0, 257, False, bytes(raw), 0.0)
    battery, lacking = source.battery(100.5)
    valid = cells_c[missing:]
    if len(valid) < 6:
        assert battery is None
        assert lacking[0].startswith('battery_temperature_c: ')
        assert lacking[0].endswith(f'{len(valid)} of 8 channels are valid, at least 6 are needed')
    else:
        expected = {'mean': sum(valid) / len(valid), 'min': min(valid), 'max': max(valid)}[combine]
        assert battery.temperature_c == pytest.approx(expected)
        assert [f'{len(valid)} of 8 channels are valid' in sentence for sentence in battery.missing] == (
            [True] if missing else [])


@pytest.mark.parametrize('raw, expected_c', [([60, 61, 62, 63, 64, 65, 0, 0], 12.5), ([60] * 5 + [0] * 3, None)])
def test_modules_that_are_not_there_are_not_in_the_mean(tmp_path, raw, expected_c):
    path = written_map(tmp_path)
    path.write_text(path.read_text().replace('BMS.Temp', "{channels: '/^Cells/', combine: mean, at_least: 6}"))
    source = CanSource(load_live_map(path), lambda: 100.0)
    source.on_frame(0, 256, False, bytes([0, 0, 160, 0, 0, 0, 0, 0]), 0.0)
    source.on_frame(0, 257, False, bytes(raw), 0.0)
    battery, lacking = source.battery(100.5)
    told = ' '.join(lacking or battery.missing)
    assert 'battery_temperature_c: -50 degC far from the others is a module that is not there' in told
    assert (battery and battery.temperature_c) == expected_c


def test_names_that_are_on_no_bus_are_told_although_battery_state_does_without_them(tmp_path):
    path = written_map(tmp_path, '  cells_c: Cells.Nope', signals=', current_a: BMS.Amps, speed_mps: ABS.Speed')
    source = CanSource(load_live_map(path), lambda: 100.0)
    source.on_frame(0, 256, False, bytes([0, 0, 160, 0, 0, 0, 0, 0]), 0.0)
    battery, _ = source.battery(100.5)
    assert set(battery.missing) == {f'{name}: is not on the bus' for name in ('current_a', 'speed_mps', 'cells_c')}


def test_aggregate_of_a_log_leaves_out_instants_with_too_few_cells(tmp_path):
    cells = [[20.0 + row + cell if (row, cell) not in ((1, 0), (2, 0), (2, 1)) else '' for cell in range(4)]
             for row in range(4)]
    lines = ['time_s,c1,c2,c3,c4,soc'] + [','.join(map(str, (600 * row, *cells[row], 0.8))) for row in range(4)]
    (tmp_path / 'log.csv').write_text('\n'.join(lines) + '\n')
    (tmp_path / 'map.yaml').write_text(
        "signals: {battery_temperature_c: {channels: '/^c\\d$/', at_least: 3, unit: degC}, soc: soc}\n")
    series = read_recording(tmp_path / 'log.csv', tmp_path / 'map.yaml').signals['battery_temperature_c']
    assert list(series.time_s) == [0.0, 600.0, 1800.0]
    assert list(series.value) == pytest.approx([21.5, 23.0, 24.5])


# --- Two buses ---


def test_two_buses_with_the_same_identifiers_are_kept_apart(tmp_path):
    import can
    (tmp_path / 'battery.dbc').write_text(BATTERY)
    # The heater's bus has other contents under the battery's identifier, and a message of the same name.
    (tmp_path / 'heater.dbc').write_text(
        NS + HEATER.replace('BO_ 513', 'BO_ 256') + 'BO_ 700 BMS: 8 CAR\n SG_ Temp : 0|8@1+ (1,0) [0|9] "V" GW\n')
    names = [f'{tmp_path.name}_{number}' for number in (0, 1)]
    (tmp_path / 'car.yaml').write_text(f"""
signals: {{battery_temperature_c: BMS.Temp, soc: BMS.Soc}}
live:
  can_buses:
  - {{interface: virtual, channel: {names[0]}, dbc: battery.dbc}}
  - {{interface: virtual, channel: {names[1]}, dbc: heater.dbc}}
  heater_status: {{power: HeaterState.Share}}
  heater_command: {{message: Heater, power: Share, counter: Count, full_power_w: 5000}}
""")
    first, second = (can.Bus(interface='virtual', channel=name) for name in names)
    with first, second, closing(CanSource(load_live_map(tmp_path / 'car.yaml'), steady_s)) as source:
        source.start()
        poll_until(lambda: not source.problem, 'open buses')
        battery = (-750).to_bytes(2, 'little', signed=True) + bytes([160, 0, 0, 0, 0, 0])
        first.send(can.Message(arbitration_id=256, is_extended_id=False, data=battery))
        second.send(can.Message(arbitration_id=256, is_extended_id=False, data=[100] + [0] * 7))
        poll_until(lambda: source.battery(steady_s())[0] and source.heater_status()[0] is not None,
                   'battery and heater')
        assert source.battery(steady_s())[0].temperature_c == pytest.approx(-7.5)
        assert source.heater_status()[0] == pytest.approx(2500.0)
        assert source.send_power(1000.0) == ''
        assert second.recv(5.0).data[0] == 40
        assert first.recv(0.05) is None
        assert source.name == f'virtual {names[0]} and virtual {names[1]}'


def test_long_command_is_sent_as_a_frame_of_can_fd(tmp_path):
    import can
    path = written_map(
        tmp_path, '  heater_command: {message: Heater, power: Power, counter: Count, checksum: {signal: Crc, '
        'e2e_profile: 5, data_id: 0x1234}}', BATTERY + DBC_P5_LONG[len(NS):])
    with (can.Bus(interface='virtual', channel=tmp_path.name) as bus,
          closing(CanSource(load_live_map(path), steady_s)) as source):
        source.start()
        poll_until(lambda: not source.send_power(2000.0), 'an open bus')
        frame = bus.recv(5.0)
        assert (frame.is_fd, len(frame.data), frame.data[0]) == (True, 16, 20)


def test_count_of_something_else_than_frames_is_no_reason_to_drop_them(tmp_path):
    path = written_map(tmp_path, dbc=BATTERY.replace(
        'BO_ 257', ' SG_ BMS_Fault_Cnt : 32|8@1+ (1,0) [0|255] "" GW\nBO_ 257'))
    source = CanSource(load_live_map(path), lambda: 0.0)

    def temperature_c(raw, count):
        source.on_frame(0, 256, False, bytes([0, raw, 100, 0, count, 0, 0, 0]), 0.0)
        return source.value('battery_temperature_c', 0.0)

    # A count of faults stays, and rises once; a count of frames rises with each.
    assert [temperature_c(at, count) for at, count in enumerate([4, 4, 5, 5, 5, 6, 7, 8, 8, 9])] == pytest.approx(
        [2.56 * at for at in (0, 1, 2, 3, 4, 5, 6, 7, 7, 9)])


@pytest.mark.parametrize('send_type, expected_c', [(0, 7.68), (2, 48.64)])
def test_message_that_is_also_sent_on_change_may_come_between_its_cycles(tmp_path, send_type, expected_c):
    path = written_map(tmp_path, dbc=BATTERY + f"""
BA_DEF_ BO_ "GenMsgSendType" ENUM "cyclic","spontan","cyclicAndSpontan";
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;
BA_ "GenMsgSendType" BO_ 256 {send_type};
BA_ "GenMsgCycleTime" BO_ 256 1000;
""")
    now_s = [100.0]
    source = CanSource(load_live_map(path), lambda: now_s[0])
    for raw in range(20):
        now_s[0] += 0.05
        source.on_frame(0, 256, False, bytes([0, raw, 100, 0, 0, 0, 0, 0]), 0.0)
    assert source.value('battery_temperature_c', now_s[0]) == pytest.approx(expected_c)


def test_all_bits_set_is_no_reading_but_of_a_share(tmp_path):
    # 255 is 87.5 degC and, of a full battery, 100 %; 65535 is 1310.7 V; a DBC names its whole range as limits.
    signals = ', voltage_v: BMS.Volts, current_a: BMS.Amps'
    path = written_map(tmp_path, signals=signals, dbc=NS + """BO_ 256 BMS: 8 CAR
 SG_ Temp : 0|8@1+ (0.5,-40) [-40|87.5] "degC" GW
 SG_ Soc : 8|8@1+ (0.392157,0) [0|100.1] "%" GW
 SG_ Volts : 16|16@1+ (0.02,0) [0|1310.7] "V" GW
 SG_ Amps : 32|16@1- (0.05,0) [0|0] "A" GW
""")
    source = CanSource(load_live_map(path), lambda: 0.0)
    source.on_frame(0, 256, False, bytes([255] * 8), 0.0)
    assert [source.value(name, 0.0) for name in ('battery_temperature_c', 'voltage_v')] == [None, None]
    assert source.value('soc', 0.0) == pytest.approx(1.0, abs=1e-5)
    assert source.doubts()['BMS.Volts'] == "BMS.Volts: 65535 means 'no reading: the last value of its bits'"
    # Of a signed signal both ends: -1638.4 and 1638.35 A.
    for data in (b'\x00\x80', b'\xff\x7f'):
        source.on_frame(0, 256, False, bytes([80, 100, 0, 0]) + data + bytes(2), 0.0)
        assert source.value('current_a', 0.0) == pytest.approx(-0.05)


def test_values_beyond_those_of_j1939_are_no_readings_and_are_never_commanded(tmp_path):
    # 0x98FF50FE and 0x98FF51FE are J1939 from any sender; shares, too, have at most 0xFA there.
    dbc = (BATTERY.replace('BO_ 256', f'BO_ {0x98FF50FE}').replace('[0|100] "%"', '[0|0] "%"') + HEATER.replace(
        'BO_ 512', f'BO_ {0x98FF51FE}').replace('(50,0) [0|7000] ""', '(50,0) [0|0] "W"'))
    path = written_map(tmp_path, dbc=dbc)
    source = CanSource(load_live_map(path), lambda: 0.0)
    for raw, soc in ((0xFE, None), (0xFF, None), (0xC8, 1.0)):
        source.on_frame(0, 0x18FF50F3, True, bytes([0, 1, raw, 0, 0, 0, 0, 0]), 0.0)
        assert source.value('soc', 0.0) == (None if soc is None else pytest.approx(soc))
        assert source.doubts()['BMS.Soc'].endswith("means 'error or not available (J1939)'")
    frame = heater_frame(tmp_path, 'power: Plain', dbc=dbc)
    assert (frame.highest_w, frame.next(99999.0)[3]) == (12500.0, 0xFA)


def test_message_of_j1939_is_that_of_its_first_sender(tmp_path):
    import can
    # 2566869246 is 0x98FF50FE: the group FF50, from any sender (FE).
    path = written_map(tmp_path, dbc=BATTERY.replace('BO_ 256', 'BO_ 2566869246'))

    def frame(identifier, raw, is_extended=True):
        return can.Message(arbitration_id=identifier, is_extended_id=is_extended, data=[0, raw, 100] + [0] * 5)

    with (can.Bus(interface='virtual', channel=tmp_path.name) as bus,
          closing(CanSource(load_live_map(path), steady_s)) as source):
        source.start()
        poll_until(lambda: not source.problem, 'an open bus')
        # Other groups, and a standard frame with some of the bits, are of no message.
        for sent in (frame(0x18FF51F3, 1), frame(0x050, 1, False), frame(0x0CFF50F3, 2), frame(0x18FF50F4, 3)):
            bus.send(sent)
        poll_until(source.doubts, 'a frame of another sender')
        assert source.battery(steady_s())[0].temperature_c == pytest.approx(5.12)
        assert source.doubts()['BMS'].startswith('BMS: a frame from 18FF50F4; those from CFF50F3 count')


# --- Messages on maps that do not fit ---


COMMAND = '  heater_command: {{message: Heater, counter: Count, {}}}'
MISFITS = {
    'unit of a current': (COMMAND.format('power: Current'), {}, [
        'live.heater_command.power: Heater.Current: unit', 'cannot be converted to watt']),
    'no unit': (COMMAND.format('power: Plain'), {}, ['live.heater_command.unit: is missing', 'Heater.Plain']),
    'unknown unit': (COMMAND.format('power: Plain, unit: furlong'), {}, ["'furlong' of Heater.Plain is unknown"]),
    'no full power': (COMMAND.format('power: Share'), {}, [
        'heater_command.full_power_w: is missing; Heater.Share']),
    'no law': (COMMAND.format('power: SetPoint'), {}, ['heater_command.coolant: is missing; Heater.SetPoint']),
    'no limit': (COMMAND.format(f'off_value: 0, {COOLANT.replace("maximum_power_w: 5000, ", "")}'), {}, [
        'heater_command.maximum_power_w: is missing; Heater.SetPoint']),
    'no off': (COMMAND.format(COOLANT), {}, ['heater_command.off_value: is missing; Heater.SetPoint']),
    'off that does not fit': (COMMAND.format(f'off_value: -30, {COOLANT}'), {}, [
        'live.heater_command: Heater cannot']),
    'off at full power': (COMMAND.format('power: Power, off_value: 5'), {}, [
        'live.heater_command.off_value: 5 is a value at which the heater heats']),
    'off at a set-point': (COMMAND.format(f'off_value: 20, {COOLANT}'), {}, [
        'live.heater_command.off_value: 20 is a value at which the heater heats']),
    'counter of the power': (COMMAND.format('power: Power'), {'counter: Count': 'counter: Power'}, [
        'live.heater_command.counter: Power is the signal of power already']),
    'enabled by the counter': (COMMAND.format('power: Power, enable: Count'), {}, [
        'live.heater_command.enable: Count is the signal of counter already']),
    'checksum of the power': (COMMAND.format('power: Power, checksum: {signal: Power, method: crc8}'), {}, [
        'live.heater_command.checksum.signal: Power is the signal of power already']),
    'power over another signal': (COMMAND.format('power: Power'), {'car.dbc': 'overlapping_power.dbc'}, [
        'live.heater_command: Heater cannot be made', 'Power and Share are overlapping']),
    'a message of two sources': (
        COMMAND.format('power: Power') + '\n  heat_sources: {a: {command: {message: Heater, power: Share}}}', {}, [
            'live.heat_sources.a.command.message: Heater is that of live.heater_command']),
    'follows nothing': (COMMAND.format(f'off_value: 0, {COOLANT.replace("Inlet", "Outlet")}'), {}, [
        'live.heater_command.coolant.follows: HeaterState.Outlet is no MESSAGE.SIGNAL of the DBC']),
    'follows a share': (COMMAND.format(f'off_value: 0, {COOLANT.replace("Inlet", "Share")}'), {}, [
        'live.heater_command.coolant.follows: HeaterState.Share']),
    'measured current': (COMMAND.format('power: Power') + '\n  heater_status: {power: Heater.Current}', {}, [
        'live.heater_status.power: Heater.Current: unit', 'cannot be converted to watt']),
    'signal of a current': ('', {'BMS.Temp': 'Heater.Current'}, [
        'signals.battery_temperature_c: Heater.Current: unit']),
    'signal without unit': ('', {'BMS.Temp': 'Heater.Plain'}, [
        'signals.battery_temperature_c: Heater.Plain has no unit']),
    'cells of a current': ('  cells_c: Heater.Current', {}, ['live.cells_c: Heater.Current: unit']),
    'few cells': ('', {'BMS.Temp': "{channels: '/^Cells/', at_least: 9}"}, [
        'signals.battery_temperature_c.at_least: 9 channels are needed, but the bus has only Cells.T1, ']),
    'first of some': ('', {'BMS.Temp': "{channels: '/^Cells/', at_least: 2, combine: first}"}, [
        'signals.battery_temperature_c: at_least: needs combine']),
    'no such interface': ('', {'virtual': 'no_such'}, ["live.can.interface: 'no_such' is unknown"]),
    'counter of no signal': ('  messages: {BMS: {counter: Count}}', {}, [
        'live.messages.BMS.counter: Count is no signal of BMS']),
    'checksum of no signal': ('  messages: {BMS: {checksum: {signal: Crc, method: crc8}}}', {}, [
        'live.messages.BMS.checksum.signal: Crc is no signal of BMS']),
    'checksum of 16 bits': ('  messages: {BMS: {checksum: {signal: Soc, method: crc16_ccitt}}}', {}, [
        'live.messages.BMS.checksum.signal: BMS.Soc has 8 bits from bit 16; this checksum must fill 2 bytes']),
    'method and profile': ('  messages: {BMS: {checksum: {signal: Soc, method: crc8, e2e_profile: 5}}}', {}, [
        'live.messages.BMS.checksum: must have either method or e2e_profile']),
    'profile without counter': ('  messages: {BMS: {checksum: {signal: Temp, e2e_profile: 5, data_id: 1}}}', {}, [
        'live.messages.BMS.checksum: e2e_profile 5 needs the counter of the message']),
    'counter of another profile': (
        COMMAND.format('power: Power, checksum: {signal: Plain, e2e_profile: 5, data_id: 1}'), {}, [
            'live.heater_command.checksum: Count has 4 bits; the counter of e2e_profile 5 has 8']),
    'list for a profile with one': (
        COMMAND.format(f'power: Power, checksum: {{signal: Plain, e2e_profile: 11, data_ids: {LIST}}}'), {}, [
            'live.heater_command.checksum: e2e_profile 11 needs data_id']),
    'one for a profile with a list': (
        COMMAND.format('power: Power, checksum: {signal: Plain, e2e_profile: 2, data_id: 5}'), {}, [
            'live.heater_command.checksum: e2e_profile 2 needs data_ids']),
    'prefix of a profile': (
        COMMAND.format('power: Power, checksum: {signal: Plain, e2e_profile: 11, data_id: 1, prefix: [1]}'), {}, [
            'live.heater_command.checksum: prefix does not belong to e2e_profile']),
    'mode of another profile': (COMMAND.format(
        'power: Power, checksum: {signal: Plain, e2e_profile: 11, data_id: 1, data_id_mode: low}'), {}, [
        'live.heater_command.checksum: data_id_mode of e2e_profile 11 must be both or nibble']),
    'battery that expires before the next frame': ('  messages: {BMS: {cycle_time_s: 5}}', {}, [
        'live.valid_for_s_of.battery_temperature_c: 2 s is too short for BMS.Temp, which comes every 5 s']),
    'heater that expires before the next frame': (
        COMMAND.format('power: Power') + '\n  heater_status: {power: HeaterState.Share}\n  messages: '
        '{HeaterState: {cycle_time_s: 1}}', {'counter: Count': 'counter: Count, full_power_w: 5000'}, [
            'live.heater_status.valid_for_s: 1 s is too short for HeaterState.Share, which comes every 1 s']),
    'two messages of one identifier': ('', {'BMS.Soc': 'Twin.Soc', 'car.dbc': '[car.dbc, twin.dbc]'}, [
        'BMS and Twin have the same identifier, 100; use a single message']),
    'signals that overlap': ('', {'car.dbc': 'overlapping.dbc'}, [
        'BMS: Temp and Soc overlap in the DBC (bits 12, 13, 14, 15)']),
    'two kinds of bus': ('  vss: {}', {}, ['live: must have exactly one key: can, can_buses or vss']),
}


@pytest.mark.parametrize('live, changes, texts', MISFITS.values(), ids=MISFITS)
def test_messages_on_a_map_name_file_key_and_signal(tmp_path, live, changes, texts):
    path = written_map(tmp_path, live)
    (tmp_path / 'twin.dbc').write_text(NS + 'BO_ 256 Twin: 8 CAR\n SG_ Soc : 0|8@1+ (0.5,0) [0|100] "%" GW\n')
    (tmp_path / 'overlapping.dbc').write_text((BATTERY + HEATER).replace('Soc : 16|8', 'Soc : 12|8'))
    (tmp_path / 'overlapping_power.dbc').write_text((BATTERY + HEATER).replace('Power : 8|8', 'Power : 6|8'))
    text = path.read_text()
    for before, after in changes.items():
        assert before in text
        text = text.replace(before, after)
    path.write_text(text)
    (problem,) = problems_of(lambda: CanSource(load_live_map(path), steady_s))
    assert problem.startswith(f'{path}: ')
    assert [text for text in texts if text not in problem] == [], problem


def test_each_heat_source_has_its_own_command_and_status(tmp_path):
    dbc = BATTERY + HEATER + """BO_ 600 Pump: 8 GW
 SG_ Power : 0|8@1+ (20,0) [0|5000] "W" CAR
 SG_ Count : 8|4@1+ (1,0) [0|15] "" CAR
BO_ 601 PumpState: 8 CAR
 SG_ Power : 0|8@1+ (20,0) [0|5000] "W" GW
 SG_ Fault : 8|1@1+ (1,0) [0|1] "" GW
"""
    path = written_map(tmp_path, """  heater_status: {power: HeaterState.Share}
  heater_command: {message: Heater, power: Share, counter: Count, full_power_w: 5000}
  heat_sources:
    heat_pump:
      command: {message: Pump, power: Power, counter: Count, maximum_power_w: 2500}
      status: {power: PumpState.Power, fault: PumpState.Fault}""", dbc)
    source = CanSource(load_live_map(path), lambda: 100.0)
    assert list(source.frames) == ['hvch', 'heat_pump']
    # Each has a counter of its own, and no more than its most power.
    assert [source.frames['heat_pump'].next(power_w)[:2] for power_w in (2000.0, 9000.0)] == [
        b'\x64\x01', b'\x7d\x02']
    assert source.frames['hvch'].next(2500.0)[0] == 100 and source.frames['hvch'].next(0.0)[5] >> 4 == 2
    assert source.heater_status('heat_pump')[1] == 'no valid PumpState.Fault for 1 s'
    source.on_frame(0, 601, False, bytes([75, 0, 0, 0, 0, 0, 0, 0]), 0.0)
    assert source.heater_status('heat_pump') == (1500.0, '')
    assert source.heater_status()[1] == 'no valid HeaterState.Share for 1 s'
    source.on_frame(0, 601, False, bytes([0, 1, 0, 0, 0, 0, 0, 0]), 0.0)
    assert source.heater_status('heat_pump') == (0.0, 'PumpState.Fault: 1')


@pytest.mark.parametrize('entry, told', [
    ('Pump: {command: {message: Heater, power: Power, counter: Count}}', 'heat_sources'),
    ('hvch: {command: {message: Heater, power: Power, counter: Count}}', 'heat_sources'),
    ('pump: {status: {power: HeaterState.Share}}', 'command'),
    ('pump: {command: {message: Heater, power: Power, counter: Cnt}}', 'live.heat_sources.pump.command.counter: '),
    ('pump: {command: {message: Heater, power: Power, counter: Count}, status: {fault: Heater.Heat}}',
     'live.heat_sources.pump.status.fault: Heater.Heat is no MESSAGE.SIGNAL of the DBC')])
def test_a_heat_source_that_does_not_fit_is_refused_by_its_key(tmp_path, entry, told):
    path = written_map(tmp_path, f'  heat_sources:\n    {entry}')
    [problem] = problems_of(lambda: CanSource(load_live_map(path), steady_s))
    assert told in problem
