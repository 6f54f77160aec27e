# SPDX-License-Identifier: Apache-2.0
"""One drive, written in the forms in which loggers and apps write it."""

from datetime import datetime, timedelta, UTC
import json
import struct

import numpy as np

START_S = 1_700_000_000.0
LEAFSPY_HEADER = (
    'Date/Time,Lat,Long,Elv,Speed,Gids,SOC,AHr,Pack Volts,Pack Amps,Max CP mV,Min CP mV,Avg CP mV,CP mV Diff,'
    'Judgment Value,Pack T1 F,Pack T1 C,Pack T2 F,Pack T2 C,Pack T3 F,Pack T3 C,Pack T4 F,Pack T4 C,'
    + ','.join(f'CP{number}' for number in range(1, 97)) + ',12v Bat Amps,VIN,Hx,12v Bat Volts,Odo(km),QC,L1/L2,'
    'TP-FL,TP-FR,TP-RR,TP-RL,Ambient,SOH,RegenWh,BLevel,epoch time,Motor Pwr(w),Aux Pwr(100w),A/C Pwr(250w),'
    'A/C Comp(0.1MPa),Est Pwr A/C(50w),Est Pwr Htr(250w),Plug State,Charge Mode,OBC Out Pwr,Gear,HVolt1,HVolt2,'
    'GPS Status,Power SW,BMS,OBC,Debug').split(',')


def drive(duration_s=600.0, interval_s=1.0):
    """
    Return the signals of a drive by name, at equal intervals: 40 kWh, 110 Ah, a heat pump of 1 kW.

    The charge is the integral of the current: 110 Ah at 360 V.
    """
    time_s = np.arange(0.0, duration_s + 0.5 * interval_s, interval_s)
    current_a = 45.0 + 40.0 * np.sin(time_s / 23.0)
    charge_ah = (45.0 * time_s + 40.0 * 23.0 * (1.0 - np.cos(time_s / 23.0))) / 3600.0
    speed_mps = 16.0 + 7.0 * np.sin(time_s / 31.0)
    distance_m = 16.0 * time_s + 7.0 * 31.0 * (1.0 - np.cos(time_s / 31.0))
    return {
        'time_s': time_s, 'battery_temperature_c': 3.0 + time_s / 400.0, 'soc': 0.8 - charge_ah / 110.0,
        'voltage_v': 360.0 - 0.1 * current_a, 'current_a': current_a, 'speed_mps': speed_mps,
        'ambient_c': -4.0 + 0.0 * time_s, 'cabin_heater_w': 1000.0 + 0.0 * time_s,
        'latitude_deg': 51.5 + np.degrees(distance_m / 6371008.8), 'longitude_deg': -0.125 + 0.0 * time_s}


def assert_same(recording, log, signals, **tolerance):
    """Compare signals with those of a drive, at the recording's own instants."""
    for signal in signals:
        series = recording.signals[signal]
        expected = np.interp(series.time_s + log['time_s'][0], log['time_s'], log[signal])
        np.testing.assert_allclose(series.value, expected, err_msg=signal, **tolerance)


def write_wide(path, log, separator=',', decimal='.', end='\n', mark='', names=None, times=None):
    """Write columns as CSV; `names` are other headings, `times` texts instead of seconds."""
    lines = [separator.join((names or {}).get(name, name) for name in log)]
    for at in range(len(log['time_s'])):
        cells = [times[at] if times is not None and name == 'time_s' else
                 f'{column[at]:.7g}'.replace('.', decimal) for name, column in log.items()]
        lines.append(separator.join(cells))
    path.write_bytes((mark + end.join(lines) + end).encode())
    return path


def moments(log, form):
    """Return the times of a log as texts in a format of strftime."""
    return [(datetime.fromtimestamp(START_S, UTC) + timedelta(seconds=float(second))).strftime(form)
            for second in log['time_s']]


def write_leafspy(path, log):
    """Write a log as LeafSpy does: degrees and minutes, percent x 10 000, degF outside, no third sensor."""
    rows = [','.join(LEAFSPY_HEADER)]
    for at, moment in enumerate(moments(log, '%m/%d/%Y %H:%M:%S')):
        cells = dict.fromkeys(LEAFSPY_HEADER, '0')
        for number, offset in ((1, 0.3), (2, -0.1), (4, -0.2)):
            celsius = log['battery_temperature_c'][at] + offset
            cells |= {f'Pack T{number} C': f'{celsius:.4f}', f'Pack T{number} F': f'{celsius * 1.8 + 32.0:.4f}'}
        cells |= {
            'Date/Time': moment, 'epoch time': f'{START_S + log["time_s"][at]:.0f}',
            'Pack T3 C': 'none', 'Pack T3 F': 'none', 'SOC': f'{log["soc"][at] * 1e6:.0f}',
            'Pack Volts': f'{log["voltage_v"][at]:.3f}', 'Pack Amps': f'{log["current_a"][at]:.4f}',
            'Speed': f'{3.6 * log["speed_mps"][at]:.3f}', 'Ambient': f'{log["ambient_c"][at] * 1.8 + 32.0:.2f}',
            'Est Pwr Htr(250w)': f'{log["cabin_heater_w"][at] / 250.0:.0f}', 'VIN': 'SJNFAAZE0U60XXXXX',
            '12v Bat Amps': '-7.72A', 'Elv': '23', 'Odo(km)': '12345',
            'Lat': _minutes(log['latitude_deg'][at]), 'Long': _minutes(log['longitude_deg'][at])}
        rows.append(','.join(cells[name] for name in LEAFSPY_HEADER))
    path.write_text('\n'.join(rows) + '\n', encoding='utf-8')
    return path


def _minutes(degrees):
    whole = int(abs(degrees))
    return f'{"-" if degrees < 0.0 else ""}{whole} {60.0 * (abs(degrees) - whole):.6f}'


def write_long(path, log, names):
    """Write a reading a line, channels in turn; `names` has PID, unit and factor for each signal."""
    lines = ['"SECONDS";"PID";"VALUE";"UNITS";']
    for at, second in enumerate(log['time_s']):
        signal = list(names)[at % len(names)]
        pid, unit, factor = names[signal]
        # Seconds since midnight, which passes on the way.
        lines.append(f'"{(86_100.0 + second) % 86_400.0:.3f}";"{pid}";"{factor * log[signal][at]:.6g}";"{unit}";')
    path.write_bytes(('\ufeff' + '\r\n'.join(lines) + '\r\n').encode())
    return path


def write_json_lines(path, log, names):
    """Write an object a line with one field each, as texts; `names` has key and factor for each signal."""
    lines = []
    for at, second in enumerate(log['time_s']):
        signal = list(names)[at % len(names)]
        key, factor = names[signal]
        fields = {'utc': START_S + second, key: f'{factor * log[signal][at]:.6g}'}
        lines.append(json.dumps({'car': 'x', 'tlm': fields}))
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    return path


def write_mcap(path, topic, values, **options):
    """Write `values`, {second: value}, as messages std_msgs/Float64 of a topic, all logged at 0."""
    import mcap.writer
    with open(path, 'wb') as file:
        writer = mcap.writer.Writer(file, **options)
        writer.start()
        channel = writer.register_channel(topic, 'cdr', writer.register_schema(
            'std_msgs/msg/Float64', 'ros2msg', b'float64 data'))
        for second, value in values.items():
            writer.add_message(channel, second * 10**9, struct.pack('<BBBBd', 0, 1, 0, 0, value), 0)
        writer.finish()
