# SPDX-License-Identifier: Apache-2.0
"""The frames of config/signals/example_car.dbc, packed and unpacked bit by bit, without cantools and crccheck."""

from pathlib import Path

from bev_preheat.files.input_files import find_configuration

STATUS, TEMPERATURES, COMMAND, HEATER_STATUS = 0x3A1, 0x3A2, 0x2F0, 0x2F1


def crc8_j1850(data):
    """Return the CRC-8 of SAE J1850: polynomial 0x1D, start 0xFF, inverted."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x1D if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


def packed(length, fields):
    """Return bytes with (first bit, bits, raw value) in Intel order, and the CRC in the last byte."""
    word = 0
    for first, bits, raw in fields:
        word |= (int(raw) & (1 << bits) - 1) << first
    data = word.to_bytes(length - 1, 'little')
    return data + bytes([crc8_j1850(data)])


def status_frame(soc, voltage_v, current_a, count, charging=False):
    """Return the data of BMS_Status; the state of charge is 0 ... 1, a positive current discharges."""
    return packed(8, [(0, 10, round(1000 * soc)), (10, 1, charging), (16, 13, round(10 * voltage_v)),
                      (32, 14, round(10 * current_a)), (48, 4, count)])


def temperature_frame(mean_c, count, low_c=None, high_c=None):
    """Return the data of BMS_Temperatures."""
    low_c, high_c = mean_c if low_c is None else low_c, mean_c if high_c is None else high_c
    return packed(8, [(0, 11, round(10 * (mean_c + 50))), (11, 11, round(10 * (low_c + 50))),
                      (22, 11, round(10 * (high_c + 50))), (48, 4, count)])


def heater_frame(power_w, count, refusal=0):
    return packed(4, [(0, 10, round(power_w / 10)), (10, 1, power_w > 0.0), (11, 3, refusal), (16, 4, count)])


def read_command(data):
    """Return (power [W], enabled, count, whether the checksum is right) of HVCH_Command's data."""
    word = int.from_bytes(data[:3], 'little')
    return 10.0 * (word & 0x3FF), bool(word >> 10 & 1), word >> 16 & 0xF, data[3] == crc8_j1850(data[:3])


def can_map(folder, channel, interface='slcan', bitrate=500000):
    """Return the example's signal map with another bus in place of can0; a bitrate None is left out."""
    shipped = find_configuration('signals', 'example_car', '.yaml')
    rate = '' if bitrate is None else f', bitrate: {bitrate}'
    path = folder / f'map_of_{Path(channel).name}.yaml'
    path.write_text(shipped.read_text().replace(
        'dbc: example_car.dbc', f'dbc: {shipped.with_name("example_car.dbc")}').replace(
        '{interface: socketcan, channel: can0}', f'{{interface: {interface}, channel: {channel}{rate}}}'))
    return path
