# SPDX-License-Identifier: Apache-2.0
"""CAN frames as tools print them, a line each, and DBC files with parts missing."""

import base64
from types import SimpleNamespace

import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.logs.dbc import values_of_nothing
from bev_preheat.logs.reading import read_recording

DBC = """VERSION ""
NS_ :
BS_:
BU_: BMS
BO_ 341 BMS_State: 8 BMS
 SG_ PackVoltage : 0|16@1+ (0.01,0) [0|655.35] "V" BMS
 SG_ BattTempAvg : 16|8@1+ (0.5,-40) [-40|87.5] "degC" BMS
 SG_ SOC : 24|8@1+ (0.5,0) [0|100] "%" BMS

VAL_ 341 BattTempAvg 254 "SNA" 255 "invalid";
"""
TIMES_S = 0.5 * np.arange(60)
START_S = 1_700_000_000.0


def payload(at):
    """Return 360 V, -10 + at / 2 degC, 80 %; every tenth frame has no voltage, the second no temperature."""
    volts = 65535 if at % 10 == 9 else 36000
    return bytes([volts & 255, volts >> 8, 254 if at == 1 else 60 + at, 160])


def hexes(at, mark):
    return mark.join(f'{each:02X}' for each in payload(at))


FORMS = {
    'candump': (lambda at, s: f'({START_S + s:.6f}) can0 155#{hexes(at, "")}', '', 'candump'),
    'printed': (lambda at, s: f' ({START_S + s:.6f})  can0  155   [4]  {hexes(at, " ")}', '',
                'candump on a screen'),
    'intervals': (lambda at, s: f' ({0.5 * (at > 0):010.6f})  can0  155   [4]  {hexes(at, " ")}', '',
                  'candump on a screen'),
    'with letters': (lambda at, s: f" ({s:010.6f})  can0  RX - -  155   [4]  {hexes(at, ' ')}   '....'", '',
                     'candump on a screen'),
    'asc intervals': (lambda at, s: f'{0.5 * (at > 0):.6f} 1  155  Rx   d 4 {hexes(at, " ")}',
                      'date Wed Nov 15 07:30:00.000 am 2023\nbase hex  timestamps relative\nBegin Triggerblock\n',
                      'ASC'),
    'gvret with 0x': (lambda at, s: f'{1e6 * s:.0f},0x155,0,Rx,0,4,{hexes(at, ",")},',
                      'Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n', 'SavvyCAN GVRET'),
    'gvret': (lambda at, s: f'{1e6 * s:.0f},00000155,false,Rx,0,4,{hexes(at, ",")},',
              'Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n', 'SavvyCAN GVRET'),
    # Its clock of 32 bits begins again after 71 min.
    'old gvret': (lambda at, s: f'{(4294960000 + int(1e6 * s)) % 2**32},155,false,0,4,{hexes(at, ",")}',
                  'Time Stamp,ID,Extended,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n', 'SavvyCAN GVRET'),
    'crtd': (lambda at, s: f'{START_S + s:.6f} 1R11 155 {hexes(at, " ")}', '1700000000.0 CXX a comment\n', 'CRTD'),
    'csv': (lambda at, s: f'{START_S + s},0x155,0,0,0,4,{base64.b64encode(payload(at)).decode()}',
            'timestamp,arbitration_id,extended,remote,error,dlc,data\n', 'python-can CSV'),
    'trc': (lambda at, s: f'{at + 1:7d} {1e3 * s:13.3f} DT     0155 Rx 4  {hexes(at, " ")}',
            ';$FILEVERSION=2.0\n;$STARTTIME=45000.0\n;$COLUMNS=N,O,T,I,d,l,D\n;\n', 'PCAN TRC')}


@pytest.mark.parametrize('line, head, kind', FORMS.values(), ids=FORMS)
@pytest.mark.needs('can', 'cantools')
def test_each_form_has_the_same_readings(tmp_path, line, head, kind):
    path = tmp_path / 'frames.txt'
    path.write_text(head + '\n'.join(line(at, second) for at, second in enumerate(TIMES_S)) + '\n')
    path.with_suffix('.dbc').write_text(DBC)
    recording = read_recording(path)
    assert recording.format == f'CAN frames ({kind})'
    temperature = recording.signals['battery_temperature_c']
    good = np.arange(60) != 1
    np.testing.assert_allclose(temperature.value, (-10.0 + 0.5 * np.arange(60))[good])
    np.testing.assert_allclose(temperature.time_s, TIMES_S[good], atol=1e-5)
    assert set(recording.signals['voltage_v'].value) == {360.0} and len(recording.signals['voltage_v'].value) == 54
    said = ' '.join(recording.remarks)
    assert "BattTempAvg: 87 means 'SNA'; it is dropped" in said
    assert 'PackVoltage: 655.4 has all bits set' in said or 'PackVoltage: 655.35 has all bits set' in said


# 2365542654 is 0x8CFF50FE: the group FF50, from any sender (FE).
J1939 = """BO_ 2365542654 BMS_State: 8 BMS
 SG_ PackVoltage : 0|16@1+ (0.01,0) [0|655.35] "V" BMS
 SG_ SOC : 24|8@1+ (0.5,0) [0|100] "%" BMS
VAL_ 2365542654 SOC 254 "Fehler" 253 "nicht_verfuegbar";
"""


@pytest.mark.needs('can', 'cantools')
def test_frames_of_j1939_are_those_of_the_first_sender(tmp_path):
    path = tmp_path / 'frames.log'
    path.with_suffix('.dbc').write_text(J1939)
    path.write_text(''.join(f'({at}.0) can0 18FF50F3#A08C00{254 - at if at < 2 else 160:02X}\n'
                            f'({at}.5) can0 18FF50F4#204E0014\n' for at in range(20)))
    recording = read_recording(path)
    assert set(recording.signals['voltage_v'].value) == {360.0}
    assert set(recording.signals['soc'].value) == {0.8} and len(recording.signals['soc'].value) == 18
    said = ' '.join(recording.remarks)
    assert "means 'Fehler'" in said and "means 'nicht_verfuegbar'" in said
    assert '18FF50F4; those from 18FF50F3 count (and 19 more frames)' in said
    # Without that address an identifier is of one sender.
    path.with_suffix('.dbc').write_text(J1939.replace('2365542654', '2365542645'))
    with pytest.raises(InvalidInput, match=r'none of its 40 .*DBC \(CFF50F5\); they have 18FF50F3, 18FF50F4'):
        read_recording(path)


J1939_PAYLOADS = {
    # Bits of the signal, the highest raw value that is a measurement, an error and not available.
    8: (0xFA, 0xFE, 0xFF), 10: (0x3FA, 0x3FE, 0x3FF), 12: (0xFAF, 0xFE3, 0xFF0), 16: (0xFAFF, 0xFE00, 0xFF12),
    32: (0xFAFFFFFF, 0xFE000000, 0xFF345678)}


@pytest.mark.parametrize('bits', J1939_PAYLOADS)
@pytest.mark.parametrize('mark', ['any sender', 'message', 'file', 'none'])
@pytest.mark.needs('can', 'cantools')
def test_errors_and_missing_values_of_j1939_are_no_readings(tmp_path, bits, mark):
    path = tmp_path / 'frames.log'
    # 0x98FF50FE is from any sender, 0x98FF50F3 from one.
    identifier = 0x98FF50FE if mark == 'any sender' else 0x98FF50F3
    highest, *nothing = J1939_PAYLOADS[bits]
    path.with_suffix('.dbc').write_text(
        f'VERSION ""\nBU_: BMS\nBO_ {identifier} BMS: 4 BMS\n'
        f' SG_ BattTemp : 0|{bits}@1+ ({80 / 2**bits},-20) [0|0] "degC" BMS\n'
        + 'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
          f'BA_ "VFrameFormat" BO_ {identifier} 3;\n' * (mark == 'message')
        + 'BA_DEF_ "ProtocolType" STRING;\nBA_ "ProtocolType" "J1939";\n' * (mark == 'file'))
    raws = [highest - at % 3 for at in range(18)] + nothing
    path.write_text(''.join(f'({at}.0) can0 18FF50F3#{raw.to_bytes(4, "little").hex()}\n'
                            for at, raw in enumerate(raws)))
    recording = read_recording(path)
    values = recording.signals['battery_temperature_c'].value
    expected = raws if mark == 'none' else raws[:18]
    np.testing.assert_allclose(values[:18], -20.0 + np.array(expected[:18]) * 80 / 2**bits)
    said = [remark for remark in recording.remarks if 'error or not available (J1939)' in remark]
    if mark == 'none':
        assert said == [] and len(values) >= 19
    else:
        assert len(values) == 18
        assert 'frame 19: BMS.BattTemp: ' in said[0] and said[0].endswith('it is dropped (and 1 more sample)')


OVERLAPPING = """VERSION ""
BU_: BMS
BO_ 341 BMS: 8 BMS
 SG_ Page M : 56|8@1+ (1,0) [0|0] "" BMS
 SG_ BattTemp {temperature} (0.01,-40) [0|0] "degC" BMS
 SG_ SOC {soc} (0.5,0) [0|0] "%" BMS
 SG_ PackVoltage : 32|16@1+ (0.01,0) [0|0] "V" BMS
 SG_ Unused : 28|16@1+ (1,0) [0|0] "" BMS
"""


@pytest.mark.parametrize('temperature, soc, bits', [
    (': 0|16@1+', ': 15|8@1+', '15'), (': 0|16@1+', ': 15|8@0+', '8, 9, 10, 11, 12, 13, 14, 15'),
    (': 7|16@0+', ': 15|8@0+', '8, 9, 10, 11, 12, 13, 14, 15'), (': 7|12@0+', ': 14|8@1+', '14, 15'),
    ('m1 : 0|16@1+', ': 8|8@1+', '8, 9, 10, 11, 12, 13, 14, 15'),
    ('m1 : 0|16@1+', 'm1 : 8|8@1+', '8, 9, 10, 11, 12, 13, 14, 15'),
    # Frames of different pages; bits side by side.
    ('m1 : 0|16@1+', 'm2 : 8|8@1+', ''), (': 0|16@1+', ': 16|8@1+', ''), (': 7|12@0+', ': 8|4@1+', '')])
@pytest.mark.needs('can', 'cantools')
def test_signals_that_share_bits_are_refused_if_both_are_used(tmp_path, temperature, soc, bits):
    path = tmp_path / 'frames.log'
    path.with_suffix('.dbc').write_text(OVERLAPPING.format(temperature=temperature, soc=soc))
    # An overlap of a signal that is not used does no harm.
    path.write_text(''.join(f'({at}.0) can0 155#A0 0F A0 10 A0 8C 00 {1 + at % 2:02X}\n'.replace(' ', '').replace(
        'can0', ' can0 ') for at in range(20)))
    if not bits:
        assert set(read_recording(path).signals['voltage_v'].value) == {360.0}
        return
    with pytest.raises(InvalidInput, match=rf'frames.log: BMS: .* overlap in the DBC \(bits {bits}\): correct'):
        read_recording(path)


@pytest.mark.parametrize('line', [
    '({at}.{tenth}00000) can{bus} 155#{data:04X}',
    '(1700000{at:03}.{tenth}) vcan{bus} 155 [2] {high:02X} {low:02X}',
    '{at}{tenth}00000,00000155,false,Rx,{bus},2,{high:02X},{low:02X}',
    '17000{at:05}.{tenth} {bus}R11 155 {high:02X} {low:02X}',
    '{at}.{tenth} {asc_bus} 155 Rx d 2 {high:02X} {low:02X}'],
    ids=['candump', 'candump on a screen', 'GVRET', 'CRTD', 'ASC'])
@pytest.mark.needs('can', 'cantools')
def test_frames_of_another_bus_with_the_same_identifier_do_not_count(tmp_path, line):
    path = tmp_path / 'frames.log'
    path.with_suffix('.dbc').write_text(
        'BO_ 341 BMS: 2 BMS\n SG_ BattTemp : 7|16@0- (0.01,0) [-40|80] "degC" BMS\n')
    # The battery at 5 degC on one bus; the frames of the other one, a tenth of a second later, read as 24 degC.
    rows = [line.format(at=at, tenth=bus, bus=bus, asc_bus=bus + 1, data=data, high=data >> 8, low=data & 255)
            for at in range(20) for bus, data in ((0, 500 + at), (1, 2400))]
    head = 'date Wed Jan 08 10:53:20.000 2025\nbase hex timestamps absolute\nno internal events\n'
    path.write_text(head * ('asc' in line) + '\n'.join([*rows, '']))
    recording = read_recording(path)
    np.testing.assert_allclose(recording.signals['battery_temperature_c'].value, 5.0 + 0.01 * np.arange(20))
    assert [remark for remark in recording.remarks if remark.endswith(
        'BMS: from another bus; those of the first bus count (and 19 more frames)')]


@pytest.mark.parametrize('words, mean_nothing', [
    ('SNA DataNotAvailable SignalInvalid Fehlerwert ungueltiger_Wert Implausible Unavailable SensorDefect '
     'keine_Daten Not_Supported Open_Circuit Sensor_Failure Lost_Communication Timeout', True),
    ('Off Normal Full Charging Finite not_charging Warm', False)])
def test_names_of_values_say_whether_there_is_a_reading(words, mean_nothing):
    choices = dict(enumerate(words.split()))
    assert values_of_nothing(SimpleNamespace(choices=choices)) == (choices if mean_nothing else {})


@pytest.mark.needs('can', 'cantools')
def test_an_end_of_a_signed_signal_is_no_reading(tmp_path):
    path = tmp_path / 'frames.log'
    path.with_suffix('.dbc').write_text(
        'BO_ 341 BMS: 2 BMS\n SG_ BattCurrent : 0|16@1- (0.05,0) [0|0] "A" BMS\n')
    # -20 A, and twice 0x8000, which would be -1638.4 A.
    path.write_text(''.join(f'({at}.0) can0 155#{"0080" if at in (3, 4) else "70FE"}\n' for at in range(20)))
    values = read_recording(path).signals['current_a'].value
    assert set(values) == {-20.0} and len(values) == 18


@pytest.mark.parametrize('text, told', [
    pytest.param('\n'.join(f'  can0  155   [4]  {hexes(at, " ")}' for at in range(9)),
                 ', line 1: the frame has no time; record with candump -L',
                 marks=pytest.mark.needs('can', 'cantools')),
    ('\n'.join(['Time,Identifier,DLC,Data', *(f'{s},155,4,{hexes(at, " ")}' for at, s in enumerate(TIMES_S))]),
     'CAN frames in a form that is not read; save them as candump')], ids=['without times', 'of another tool'])
def test_frames_that_cannot_be_read_are_refused_with_advice(tmp_path, text, told):
    path = tmp_path / 'frames.txt'
    path.write_text(text)
    path.with_suffix('.dbc').write_text(DBC)
    with pytest.raises(InvalidInput, match=f'frames.txt.*{told}'):
        read_recording(path)


@pytest.mark.parametrize('dbc', [
    DBC.replace('degC', '°C').encode(), DBC.replace('degC', '°C').encode('cp1252'),
    DBC.replace('BS_:\n', '').encode(), DBC.replace('BU_: BMS\n', '').encode(),
    DBC.replace('BS_:\nBU_: BMS\n', '').encode(),
    f'{DBC}BO_ 342 Other: 1 BMS\n SG_ Long : 0|16@1+ (1,0) [0|65535] "" BMS\n'.encode()],
    ids=['UTF-8', 'Windows', 'no bit timing', 'no nodes', 'neither', 'another message too short'])
@pytest.mark.needs('can', 'cantools')
def test_a_dbc_with_other_or_missing_parts_is_read(tmp_path, dbc):
    line, _, _ = FORMS['candump']
    path = tmp_path / 'frames.log'
    path.write_text('\n'.join(line(at, second) for at, second in enumerate(TIMES_S)))
    path.with_suffix('.dbc').write_bytes(dbc)
    recording = read_recording(path)
    assert recording.signals['soc'].value == pytest.approx(0.8)
    assert recording.sources['battery_temperature_c'] == ('BMS_State.BattTempAvg [degC]',)
