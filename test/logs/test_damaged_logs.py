# SPDX-License-Identifier: Apache-2.0
"""Damaged logs are read or refused, never a traceback; memory stays bounded."""

from random import Random

from logs_written import drive, write_json_lines, write_leafspy, write_long, write_wide
from mutations import mutated
import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.logs import samples as samples_module
from bev_preheat.logs.reading import read_recording
from bev_preheat.logs.samples import Samples

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
@pytest.mark.needs('pint')
@pytest.mark.needs('can')
@pytest.mark.needs('cantools')
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
    monkeypatch.setattr(samples_module, 'MOST_SAMPLES', 100)
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
    monkeypatch.setattr('bev_preheat.logs.text_lines.LONGEST_LINE', 1 << 20)
    path = tmp_path / 'a.csv'
    path.write_text('time_s,speed_mps\n0,1\n1,2\n' + '3,' * (1 << 21), encoding='utf-8')
    with pytest.raises(InvalidInput, match='line 4: has more than 1048576 characters'):
        read_recording(path)
