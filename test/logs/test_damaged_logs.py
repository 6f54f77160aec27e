# SPDX-License-Identifier: Apache-2.0
"""Damaged logs are read or refused, never a traceback; memory stays bounded."""

import os
from random import Random
import signal
import time
import zlib

from logs_written import drive, write_json_lines, write_leafspy, write_long, write_mcap, write_wide
from mistakes import mutated
import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.logs import assembly, mdf
from bev_preheat.logs.assembly import Samples
from bev_preheat.logs.mdf import in_child, ReaderLost
from bev_preheat.logs.reading import read_recording

CANDUMP = b''.join(b'(170000%04d.5) can0 155#%016X\n' % (at, at * 7919) for at in range(40))
DBC = ('BU_: A\nBO_ 341 State: 8 A\n SG_ PackVoltage : 0|16@1+ (0.1,0) [0|0] "V" A\n'
       ' SG_ SOC : 16|8@1+ (0.5,0) [0|0] "%" A\n')


def files(folder):
    """Return {suffix: contents} of a log of each form of text, and of candump."""
    log = drive(40.0)
    names = {'speed_mps': ('speed', 3.6), 'soc': ('soc', 100.0), 'battery_temperature_c': ('batt_temp', 1.0)}
    pids = {'speed_mps': ('Geschwindigkeit', 'km/h', 3.6), 'soc': ('SOC', '%', 100.0)}
    written = (write_wide(folder / 'a', log), write_wide(folder / 'b', log, ';', ',', '\r\n', '\ufeff'),
               write_leafspy(folder / 'c', drive(170.0, 17.0)), write_long(folder / 'd', log, pids),
               write_json_lines(folder / 'e', log, names))
    return [*(path.read_bytes() for path in written), CANDUMP]


@pytest.mark.parametrize('seed', [
    pytest.param(seed, marks=[pytest.mark.deep] * (seed >= 8)) for seed in range(30)])
@pytest.mark.needs('can', 'cantools')
def test_damaged_files_are_read_or_refused(tmp_path, seed):
    path = tmp_path / 'log.log'
    (tmp_path / 'log.dbc').write_text(DBC, encoding='utf-8')
    for number, contents in enumerate(files(tmp_path)):
        path.write_bytes(mutated(contents, Random(f'{seed} {number}')))
        try:
            recording = read_recording(path, repair=bool(seed % 2))
        except InvalidInput as error:
            assert str(path) in str(error)
            continue
        for series in recording.signals.values():
            assert len(series.time_s) == len(series.value) > 0
            assert np.isfinite(series.time_s).all() and np.isfinite(series.value).all()
            assert (np.diff(series.time_s) > 0.0).all()


def test_a_long_log_is_averaged_in_bounded_memory(monkeypatch):
    monkeypatch.setattr(assembly, 'MOST_SAMPLES', 100)
    samples = Samples()
    value = np.sin(np.arange(6400) / 50.0)
    for first in range(0, 6400, 64):
        at = np.arange(first, first + 64)
        samples.add(at.astype(float), value[at], at)
        assert len(samples.arrays()[0]) <= 264
    time_s, mean, _ = samples.arrays()
    assert samples.readings == 6400 and samples.averaged == 32
    assert mean.mean() == pytest.approx(value.mean(), abs=1e-12)
    np.testing.assert_allclose(time_s, np.arange(200) * 32.0 + 15.5)
    np.testing.assert_allclose(mean, value.reshape(-1, 32).mean(axis=1), atol=1e-12)


def test_a_line_without_end_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr('bev_preheat.files.table.LONGEST_LINE', 1 << 20)
    path = tmp_path / 'a.csv'
    path.write_text('time_s,speed_mps\n0,1\n1,2\n' + '3,' * (1 << 21), encoding='utf-8')
    with pytest.raises(InvalidInput, match='line 4: has more than 1048576 characters'):
        read_recording(path)


def reader_that(does):
    yield 1
    if does == 'crashes':
        os.kill(os.getpid(), signal.SIGKILL)
    while does == 'waits':
        time.sleep(0.1)
    if does == 'fails':
        raise InvalidInput('no')
    yield 2


@pytest.mark.parametrize('does, error, words', [
    ('crashes', ReaderLost, 'its reader crashed'), ('waits', ReaderLost, 'nothing could be read for 0.5 s'),
    ('fails', InvalidInput, 'no')])
def test_a_reader_that_crashes_waits_or_fails_ends_and_has_yielded_before(monkeypatch, does, error, words):
    read = []
    with monkeypatch.context() as impatient, pytest.raises(error, match=words):
        if does == 'waits':
            impatient.setattr(mdf, 'LONGEST_WAIT_S', 0.5)
        read.extend(in_child(reader_that, does))
    read.append(next(in_child(reader_that, does)))
    assert list(in_child(reader_that, 'ends')) == [1, 2]


def write_blf(folder, frames, compression_level):
    """Write the data of frames, one a second, as a BLF file beside their DBC; return its path."""
    import can
    (folder / 'a.dbc').write_text(DBC, encoding='utf-8')
    with can.BLFWriter(folder / 'a.blf', compression_level=compression_level) as file:
        for at, data in enumerate(frames):
            file.on_message_received(can.Message(
                timestamp=1.7e9 + at, arbitration_id=341, is_extended_id=False, data=bytes(data)))
    return folder / 'a.blf'


@pytest.mark.parametrize('level', [0, -1])
@pytest.mark.needs('can', 'cantools')
def test_blf_objects_without_length_end_the_log_and_are_named(tmp_path, level):
    path = write_blf(tmp_path, [[16, 14, 160, 0, 0, 0, 0, 0]] * 200, level)
    assert len(read_recording(path).signals['soc'].value) == 200
    contents = bytearray(path.read_bytes())
    # The container behind the head of the file: its own head, that of the compression, then objects.
    start = 144 + 32
    objects = bytearray(contents[start:] if level == 0 else zlib.decompress(contents[start:]))
    # Of the 20th object.
    length = int.from_bytes(objects[8:12], 'little')
    objects[20 * length + 8:20 * length + 12] = bytes(4)
    contents[start:] = objects if level == 0 else zlib.compress(objects)
    contents[144 + 8:144 + 12] = (len(contents) - 144).to_bytes(4, 'little')
    path.write_bytes(contents)
    recording = read_recording(path)
    assert len(recording.signals['soc'].value) == 20
    assert any('is damaged' in remark and 'shorter than its header' in remark for remark in recording.remarks)


@pytest.mark.parametrize('share', [0.3, 0.5, 0.99])
@pytest.mark.parametrize('level', [0, -1])
@pytest.mark.needs('can', 'cantools')
def test_a_blf_file_that_is_cut_is_named(tmp_path, level, share):
    path = write_blf(tmp_path, ([16, 14, at, 0, 0, 0, 200 - at, 0] for at in range(200)), level)
    contents = path.read_bytes()
    kept = round(share * len(contents))
    assert not [remark for remark in read_recording(path).remarks if 'damaged' in remark]
    path.write_bytes(contents[:kept])
    recording = read_recording(path)
    assert 0 < len(recording.signals['voltage_v'].value) < 200
    assert any(f"is damaged ('has {kept} of the {len(contents)} bytes" in remark for remark in recording.remarks)


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.needs('can', 'cantools', 'asammdf', 'mcap', 'rosbags')
def test_binary_files_with_lengths_of_zero_or_all_ones_end_within_seconds(tmp_path, seed):
    import asammdf
    import mcap.writer
    write_blf(tmp_path, [bytes(8)] * 50, 0)
    mdf = asammdf.MDF(version='4.10')
    mdf.append(asammdf.Signal(np.arange(50.0), np.arange(50.0), name='speed', unit='km/h'))
    mdf.save(tmp_path / 'a.mf4')
    mdf.close()
    write_mcap(tmp_path / 'a.mcap', '/speed', dict.fromkeys(range(50), 0.0),
               compression=mcap.writer.CompressionType.NONE)
    random = Random(seed)
    for path in sorted(tmp_path.glob('a.[bm]*')):
        contents = path.read_bytes()
        for _ in range(12):
            damaged, width = bytearray(contents), random.choice((2, 4, 8))
            at = random.randrange(len(damaged) - width)
            damaged[at:at + width] = random.choice((b'\0', b'\xff')) * width
            path.write_bytes(damaged)
            started_s = time.monotonic()
            try:
                read_recording(path)
            except InvalidInput as error:
                assert path.name in str(error)
            assert time.monotonic() - started_s < 30.0
