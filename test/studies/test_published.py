# SPDX-License-Identifier: Apache-2.0
"""Cars whose charging times and battery temperatures are published."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from bev_preheat.errors import InvalidInput
from bev_preheat_studies.__main__ import main
from bev_preheat_studies.published import computed_times, computed_warmth, FIGURES


@pytest.fixture(scope='module')
def times():
    return computed_times()


def test_at_least_eight_cars_with_a_source_for_each_time(times):
    assert len({time.car for time in times}) >= 8
    assert all(time.source for time in times)


def test_shipped_cars_charge_in_their_published_time_within_a_tenth(times):
    shipped = [time for time in times if time.shipped_min is not None and (
        time.start_soc <= 0.1 and time.end_soc == 0.8)]
    assert {time.car for time in shipped} == {'Peugeot e-208', 'BYD Atto 3', 'Audi e-tron 55'}
    for time in shipped:
        assert time.shipped_min == pytest.approx(time.published_min, rel=0.1), time


def test_published_curves_and_times_up_to_80_percent_belong_together(times):
    """Curve and time are of different sources or measurements, so this checks the session."""
    from_curves = [time for time in times if time.curve_min is not None and time.end_soc == 0.8]
    assert len(from_curves) >= 6
    for time in from_curves:
        assert time.curve_min == pytest.approx(time.published_min, rel=0.13), time
    ratios = [time.curve_min / time.published_min for time in from_curves]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.07)


def test_a_file_of_times_with_a_wrong_car_is_refused_with_its_name(tmp_path):
    contents = yaml.safe_load(FIGURES.read_text())
    contents['cars'] = contents['cars'][:1]
    contents['cars'][0]['data_sheet']['charging_power_kw'] = 100000
    file = tmp_path / 'times.yaml'
    file.write_text(yaml.safe_dump(contents))
    with pytest.raises(InvalidInput) as refused:
        computed_times(file)
    assert refused.value.problems == [
        f'{file}: VW ID.3 Pro: --charging-power-kw: 100000 kW is implausible; it must be 5 ... 2000 kW; 100000 W '
        'would be 100 kW']


@pytest.fixture(scope='module')
def warmth():
    return computed_warmth()


def test_batteries_warm_in_sessions_as_their_owners_read_it_within_30_percent(warmth):
    _, sessions = warmth
    compared = [session for session in sessions if session.not_comparable is None]
    assert len(compared) >= 3 and all(session.source for session in sessions)
    for session in compared:
        assert abs(session.deviation) < 0.3, session


@pytest.mark.costly
def test_published_prints_published_against_computed_figures(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv('COLUMNS', '120')
    monkeypatch.chdir(tmp_path)
    assert main(['published', '--json', 'published.json']) == 0
    output, errors = capsys.readouterr()
    assert errors == ''
    assert 'not comparable: the definition' in output
    assert 'Polestar 2 Long Range, 30 ... 70 %: a session that began at 30 %' in output
    figures = json.loads(Path('published.json').read_text())
    assert any('km77.com' in time['source'] for time in figures['times'])
    for time in figures['times']:
        assert time['car'] in output and f'{time["data_sheet_min"]:.1f}' in output
    for warmth in (*figures['heating_runs'], *figures['sessions']):
        assert warmth['car'] in output and f'{warmth["computed_c"]:.1f}' in output
