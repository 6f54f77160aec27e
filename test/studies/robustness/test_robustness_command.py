# SPDX-License-Identifier: Apache-2.0
"""`preheat robustness`: tables, files, pictures, and refusals."""

from contextlib import suppress
from dataclasses import asdict
import json
import os
import pty
import re
import signal
import subprocess
import sys

import numpy as np
import psutil
import pytest
from rich.console import Console
from run_here import Here
from short_drives import made_drive, made_result, short_conditions

from bev_preheat.commands.main import main
from bev_preheat.console.program import Interrupted
from bev_preheat_studies.commands import robustness, robustness_days, robustness_signals
from bev_preheat_studies.commands.robustness import print_summary
from bev_preheat_studies.drawing.robustness_figure import draw_robustness
from bev_preheat_studies.robustness.car_figures import summarise_drives
from bev_preheat_studies.robustness.car_study import COMPARED
from bev_preheat_studies.robustness.signal_cases import CASES

pytestmark = pytest.mark.costly


@pytest.fixture
def arguments(tmp_path):
    """The short trip as command line arguments."""
    route = asdict(short_conditions().routes[0])
    file = tmp_path / 'short.csv'
    rows = [','.join(route), *(','.join(map(str, row)) for row in zip(*route.values()))]
    file.write_text('\n'.join(rows) + '\n', encoding='utf-8')
    return ['robustness', '--route', str(file), '--temperature', '15', '--soc', '0.8', '--target',
            '18', '--period', '10', '--seed', '7']


@pytest.fixture
def in_this_process(monkeypatch):
    """Run studies without worker processes; test/studies/optimality drives a study with them."""
    for command in (robustness, robustness_days, robustness_signals):
        monkeypatch.setattr(command, 'study_executor', lambda arguments: Here())


def test_study_is_printed_and_written(in_this_process, arguments, tmp_path, capsys):
    file = tmp_path / 'study.json'
    assert main([*arguments, '--trips', '1', '--jobs', '1', '--json', str(file)]) == 0
    printed = capsys.readouterr().out
    for text in ('heat capacity ±10 %', 'logarithm 0.2', 'noise 0.2 K', 'Requirements',
                 'replanned_paper', 'at least -0.5 K', 'extreme trips (--only NUMBER)'):
        assert text in ' '.join(printed.split())
    written = json.loads(file.read_text(encoding='utf-8'))
    assert [result['number'] for result in written['results']] == [0]
    assert written['drawn']['spread']['leakage'] == 0.2
    assert (written['seed'], written['period_s'], written['temperature_c'],
            written['soc']) == (7, 10.0, 15.0, 0.8)
    for method in COMPARED:
        error_k = written['results'][0]['methods'][method]['arrival_error_k']
        assert written['summary'][method]['arrival_error_k']['median'] == error_k


def test_days_are_printed_written_and_gone_on_with(in_this_process, arguments, tmp_path, capsys):
    file, results = tmp_path / 'days.json', tmp_path / 'days.jsonl'
    study = [*arguments, '--days', '--jobs', '1', '--json', str(file), '--results', str(results)]
    assert main([*study, '--trips', '1']) == 0
    first = capsys.readouterr().out
    # The day is read back, not driven again.
    assert main([*study, '--trips', '1']) == 0
    printed = capsys.readouterr().out
    assert printed == first
    printed = ' '.join(printed.split())
    for text in ('1 days with', 'later, time known', 'Heating while parked, beyond the stated time',
                 'Requirements', 'healthy heaters reported as faulty'):
        assert text in printed
    written = json.loads(file.read_text(encoding='utf-8'))
    assert [result['number'] for result in written['results']] == [0]
    assert written['summary']['trips'] == sum(len(result['trips']) for result in written['results'])


@pytest.mark.deep
def test_one_day_is_driven_by_itself(arguments, capsys):
    assert main([*arguments, '--days', '--only', '1']) == 0
    assert 'day 1:' in capsys.readouterr().out


def test_signals_are_printed_and_written(in_this_process, arguments, tmp_path, capsys, monkeypatch):
    for name in set(CASES) - {'current reversed', 'voltage 300'}:
        monkeypatch.delitem(CASES, name)
    file = tmp_path / 'signals.json'
    assert main([*arguments, '--signals', '--trips', '1', '--jobs', '1', '--json', str(file)]) == 0
    assert 'current reversed' in capsys.readouterr().out
    written = json.loads(file.read_text(encoding='utf-8'))
    assert written['summary'].keys() == {result['case'] for result in written['results']}


@pytest.mark.parametrize('kind, option', [
    ('--days', ['--plot', 'days.png']), ('--days', ['--progress']), ('--days', ['--traffic', '0.1']),
    ('--days', ['--no-power']), ('--signals', ['--fault', 'dead']), ('--signals', ['--only', '3'])])
def test_what_a_kind_of_study_draws_itself_is_refused(arguments, capsys, kind, option):
    assert main([*arguments, kind, *option]) == 2
    assert f'{option[0]}: not allowed with {kind}' in ' '.join(capsys.readouterr().err.split())


@pytest.mark.deep
def test_one_trip_of_a_study_is_the_same_by_itself(arguments, tmp_path, capsys):
    study, single, picture = (tmp_path / name for name in ('study.json', 'one.json', 'one.png'))
    methods = ['--methods', 'planner']
    main([*arguments, *methods, '--trips', '2', '--jobs', '1', '--json', str(study)])
    assert main([*arguments, *methods, '--only', '1', '--json', str(single), '--plot',
                 str(picture)]) == 0
    assert 'trip 1: heat capacity' in capsys.readouterr().out
    of_study = json.loads(study.read_text(encoding='utf-8'))['results'][1]
    written = json.loads(single.read_text(encoding='utf-8'))
    for result in (of_study, written['result']):
        del result['cpu_s'], result['methods']['planner']['planner_cpu_s']
    assert of_study == written['result']
    course = written['courses']['planner']
    assert len(course['time_s']) == len(course['command_w']) == 48
    from matplotlib.image import imread
    assert imread(picture).shape[2] == 4


def test_battery_states_without_power_make_another_drive(arguments, tmp_path):
    courses = []
    for extra in ([], ['--no-power']):
        file = tmp_path / f'{len(extra)}.json'
        assert main([*arguments, '--only', '1', '--methods', 'planner', '--json', str(file),
                     *extra]) == 0
        courses.append(json.loads(file.read_text(encoding='utf-8'))['courses']['planner'])
    measured, unknown = courses
    assert measured['measured_c'][:10] == unknown['measured_c'][:10]
    assert measured['predicted_arrival_c'] != unknown['predicted_arrival_c']


@pytest.mark.parametrize('extra, message', [
    (['--trips', '0'], '--trips: 0 is not allowed; it must be 1 ... 100000'),
    (['--only', '-1'], '--only: -1 is not allowed; it must be 0 ... '),
    (['--seed', '-1'], '--seed: -1 is not allowed; it must be 0 ... '),
    (['--jobs', '0'], '--jobs: 0 is not allowed; it must be 1 ... 1024'),
    (['--only', '1', '--results', 'x.jsonl'], '--results and --cluster are for a whole study; --only runs'),
    (['--period', '0.01'], '--period: 0.01 is not allowed; it must be 0.1 ... 10'),
    (['--period', 'nan'], '--period: nan is not allowed; it must be 0.1 ... 10'),
    (['--temperature', '90'], 'battery temperature: 90 is not allowed; it must be -40 ... 60'),
    (['--soc', '1.2'], 'state of charge: 1.2 is not allowed; it must be 0 ... 1'),
    (['--target', 'nan'], 'target battery temperature: nan is not allowed; it must be -40 ... 60'),
    (['--vehicle', 'referenz'], "vehicle 'referenz' is unknown; did you mean 'reference'"),
])
def test_bad_options_are_refused(arguments, extra, message, capsys):
    assert main([*arguments, *extra]) == 2
    assert f'preheat: error: {message}' in capsys.readouterr().err


def test_unknown_method_is_refused(arguments, capsys):
    with pytest.raises(SystemExit):
        main([*arguments, '--methods', 'best'])
    assert "'best'" in capsys.readouterr().err


def table_of(results, methods):
    console = Console(record=True, width=160)
    print_summary(console, summarise_drives(results, methods), methods)
    return console.export_text()


def row_of(text, heading):
    return next(line for line in text.splitlines() if heading in line)


def test_requirements_are_judged_for_each_method():
    text = table_of([made_result(0, planner=made_drive(switch_ons=2),
                                 replanned_paper=made_drive(switch_ons=5))],
                    ['replanned_paper', 'planner'])
    row = row_of(text, 'switch-ons in any run')
    assert '5 not met' in row and '2 met' in row
    assert row.index('5 not met') < row.index('2 met')


def test_energies_are_shown_in_per_cent():
    text = table_of([made_result(0, planner=made_drive(heating_energy_wh=205.0))], ['planner'])
    assert '+2.50' in row_of(text, 'above plan with true car, mean [%]')
    assert '+2.50 % met' in row_of(text, 'heating energy above plan with true car, mean')


def test_where_no_trip_arrives_as_warm_as_the_informed_one_its_energy_is_not_judged():
    results = [made_result(0, planner=made_drive(arrival_error_k=-0.5))]
    row = row_of(table_of(results, ['planner']), 'heating energy above plan with true car, mean')
    assert 'no trip to compare' in row and 'met' not in row


# test/studies/test_study_figures.py draws the figures daily.
@pytest.mark.deep
@pytest.mark.parametrize('switch_ons', [0, 1, 400])
def test_trips_without_heating_can_be_shown(switch_ons, tmp_path):
    results = [made_result(
        number, made_drive(heating_energy_wh=0.0),
        planner=made_drive(heating_energy_wh=0.0, switch_ons=switch_ons, first_switch_on_s=None))
        for number in range(2)]
    assert '–' in row_of(table_of(results, ['planner']), 'above plan with true car, 95 %')
    file = tmp_path / 'picture.png'
    draw_robustness(file, results, ['planner'])
    from matplotlib.image import imread
    assert len(np.unique(imread(file)[:, :, :3].reshape(-1, 3), axis=0)) > 10


def test_picture_in_an_unknown_format_is_refused(arguments, tmp_path, capsys):
    assert main([*arguments, '--only', '0', '--methods', 'planner', '--plot',
                 str(tmp_path / 'one.txt')]) == 2
    assert 'one.txt: must end in .png or .svg or .pdf' in capsys.readouterr().err


def test_an_interrupted_study_keeps_what_is_finished(arguments, monkeypatch, tmp_path, capsys):
    def run_study(conditions, trips, seed, executor, methods, report, finished, keep):
        for number in range(3):
            report(made_result(number, **{method: made_drive() for method in methods}))
        raise Interrupted

    monkeypatch.setattr(robustness, 'run_study', run_study)
    file = tmp_path / 'study.json'
    assert main([*arguments, '--trips', '50', '--json', str(file)]) == 130
    out, err = capsys.readouterr()
    assert err == f'preheat: interrupted after 3 of 50 trips; finished results are in {file}\n'
    assert 'part of the study has run, 3 of 50 trips' in ' '.join(out.split())
    written = json.loads(file.read_text(encoding='utf-8'))
    assert (written['complete'], written['trips'], len(written['results'])) == (False, 50, 3)


# An interrupted study keeps its results above, and leaves no worker in test/studies/test_numbered.py, both daily.
@pytest.mark.deep
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_study_and_its_workers(arguments, tmp_path, number):
    """In a terminal, which shows progress; SIGINT goes to all processes, as with Ctrl-C."""
    file = tmp_path / 'study.json'
    terminal, its_end = pty.openpty()
    started = subprocess.Popen(
        [sys.executable, '-m', 'bev_preheat', *arguments, '--methods', 'replanned_paper',
         '--trips', '999', '--jobs', '2', '--json', str(file)],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=its_end,
        start_new_session=True, env=dict(os.environ, TERM='xterm', COLUMNS='100'))
    os.close(its_end)
    try:
        seen = ''
        while not re.search(r'\b[1-9]\d*/999', seen):
            seen += os.read(terminal, 1000).decode(errors='replace')
        workers = psutil.Process(started.pid).children()
        if number == signal.SIGINT:
            os.killpg(started.pid, number)
        else:
            started.send_signal(number)
        with suppress(OSError):  # its other end is closed
            while more := os.read(terminal, 1000).decode(errors='replace'):
                seen += more
        assert started.wait(30.0) == 130
    finally:
        started.kill()
    assert psutil.wait_procs(workers, 10.0)[1] == []
    assert 'Traceback' not in seen
    found = re.search(r'preheat: interrupted after (\d+) of 999 trips; finished results are in '
                      f'{file}\r\n$', seen)
    results = json.loads(file.read_text(encoding='utf-8'))['results']
    assert [result['number'] for result in results] == list(range(int(found[1])))
