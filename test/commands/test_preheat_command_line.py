# SPDX-License-Identifier: Apache-2.0
"""Common behaviour of all subcommands: JSON alone on standard output, version, one-line refusals, completion."""

from argparse import ArgumentParser
import importlib.util
import json
import os
import subprocess
import sys
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest

from bev_preheat.commands import parser as console_parser
from bev_preheat.commands.main import SUBCOMMANDS
from bev_preheat.commands.parser import completed_by
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.simulation import scenario_drive
from bev_preheat.simulation.scenario_drive import DriveRecord

SITUATION = ['--vehicle', 'reference', '--route', 'winter_commute', '--temperature', '-5', '--soc',
             '0.8']


@pytest.fixture
def quick_scenario(monkeypatch):
    """Replace the scenario by one without a drive."""
    monkeypatch.setattr(scenario_drive, 'drive_scenario', lambda scenario, report: DriveRecord(25.0))


@pytest.mark.costly
@pytest.mark.parametrize('arguments', [
    ['plan', *SITUATION], ['scenario', 'nominal'],
    # The tests of results read those of the other commands from standard output.
    *(pytest.param(arguments, marks=[pytest.mark.deep, pytest.mark.needs('casadi')]) for arguments in (
        ['plan', '--itinerary', 'winter_holiday', '--vehicle', 'reference', '--temperature', '-8', '--soc', '0.9'],
        ['compare', *SITUATION], ['reproduce'],
        ['robustness', '--trips', '1', '--period', '10', '--route', 'winter_commute', '--methods',
         'replanned_paper', '--jobs', '1']))], ids=lambda arguments: ' '.join(arguments[:2]))
def test_json_has_standard_output_for_itself(quick_scenario, said, arguments):
    status, out, err = said(*arguments, '--json', '-')
    # The scenario's car never arrived.
    assert status == (1 if arguments[0] == 'scenario' else 0)
    assert isinstance(json.loads(out), dict)
    # Tables are drawn with lines.
    assert '━' in err or '─' in err


@pytest.mark.parametrize('arguments, named', [
    (['charge', '--vehicle', 'reference', '--charger-power', '50000', '--arrival-soc', '0.2', '--ambient', '0',
      '--arrival-temperature', '-5', '--arrival-temperature', '5', '25'], '3 values'),
    (['route', '--vehicle', 'reference', '--output', 'r.csv', '--log', 'no.csv', '--log', 'log.csv'], 'no.csv'),
    (['vehicle', 'new', '--chemistry', 'nmc', '--charging-power-kw', '50', '--usable-energy-kwh', '40',
      '--nominal-voltage-v', '350', '--output', 'v.yaml', '--charging-curve-temperature-c', '30',
      '--charging-curve', 'no.csv', '--charging-curve', 'curve.csv'], 'no.csv'),
    (['worth', *SITUATION, '--route', 'reference', '--chargers', 'reference', '--end-soc', '0.3',
      '--only', 'kiosk', '--only', 'mall'], 'kiosk'),
    (['robustness', '--trips', '1', '--route', 'no.csv', '--route', 'reference'], 'no.csv')],
    ids=lambda arguments: arguments[0] if isinstance(arguments, list) else '')
def test_a_list_given_in_parts_is_whole(refused, arguments, named):
    assert named in refused(*arguments)


def test_version_is_that_of_the_manifest(said):
    manifest = configuration_folder('vehicles').parents[1] / 'package.xml'
    assert said('--version') == (0, f'preheat {ElementTree.parse(manifest).findtext("version")}\n', '')


@pytest.mark.parametrize('arguments, message', [
    (['plan', *SITUATION, '--tmperature', '3'],
     'preheat plan: error: unrecognized arguments: --tmperature; did you mean --temperature?; '
     'see preheat plan --help'),
    # Reported before the arguments that are missing as a result.
    (['plan', '--vehicel', 'reference'],
     'preheat plan: error: unrecognized arguments: --vehicel; did you mean --vehicle?; see preheat plan --help'),
    # argparse takes it for no value.
    (['plan', '--target=--', *SITUATION],
     "preheat plan: error: argument --target: '--' is not allowed; see preheat plan --help"),
    (['plan', *SITUATION, '--soc', '0,9'], "preheat plan: error: argument --soc: '0,9' is not a number; give it "
     'without a unit and with a decimal point; see preheat plan --help'),
    (['plan', *SITUATION, '--temperature', '-7C'], "preheat plan: error: argument --temperature: '-7C' is not a "
     'number; give it without a unit and with a decimal point; see preheat plan --help'),
    (['plan', '--vehicle', 'reference', '--route', 'reference', '--soc', '0.5'],
     'preheat plan: error: the following arguments are required: --temperature; see preheat plan --help'),
    (['sweep', '--seed', '1e9'],
     "preheat sweep: error: argument --seed: '1e9' is not a whole number; use digits only; "
     'see preheat sweep --help'),
    (['scenario', 'nominal', '--logs', '.'], 'preheat: error: --logs: only with --nodes'),
    (['scenario', '--list', '--json', 'x.json'], 'preheat: error: --json: not allowed with --list'),
    (['plan', *SITUATION, 'home.csv'],
     'preheat plan: error: unrecognized arguments: home.csv; see preheat plan --help'),
    (['vehicle', 'list', 'small_car'],
     'preheat vehicle list: error: unrecognized arguments: small_car; see preheat vehicle list --help')])
def test_wrong_use_is_one_line(said, arguments, message):
    assert said(*arguments) == (2, '', f'{message}\n')


@pytest.fixture
def without_studies(monkeypatch):
    """Make the studies uninstalled."""
    monkeypatch.setattr(console_parser, 'find_spec', lambda name: (
        None if name == 'bev_preheat_studies' else importlib.util.find_spec(name)))


@pytest.mark.parametrize('arguments', [
    ['sweep', '--feasible', '10'], ['robustness', '--help'], ['reproduce'], ['sweep', '-1', '--', '-x']],
    ids=' '.join)
def test_a_study_that_is_not_installed_is_refused_in_one_line(without_studies, refused, arguments):
    assert refused(*arguments) == (
        f'{arguments[0]}: the studies, which measure the planner, are not installed; build bev_preheat without '
        'BEV_PREHEAT_WITHOUT_STUDIES')


@pytest.mark.parametrize('arguments, hint', [
    (['plna'], "'plna' is no command; did you mean preheat plan? there are: "),
    (['plans', '--vehicle', 'reference'], "'plans' is no command; did you mean preheat plan? there are: "),
    (['--verbose', 'wroth'], "'wroth' is no command; did you mean preheat worth? there are: "),
    (['xyz'], "'xyz' is no command; there are: ")])
def test_an_unknown_command_is_refused_with_the_nearest_and_all_that_there_are(refused, arguments, hint):
    line = refused(*arguments)
    assert hint in line and all(name in line for name in SUBCOMMANDS)


@pytest.mark.parametrize('arguments, usage', [
    ([], 'usage: preheat [-h] '), (['vehicle'], 'usage: preheat vehicle ')])
def test_a_command_alone_prints_its_help(said, arguments, usage):
    status, out, err = said(*arguments)
    assert (status, err) == (0, '') and out.startswith(usage)
    assert said(*arguments, '--help')[1] == out


@pytest.mark.parametrize('option, name, problem', [
    ('--vehicle', 'mein', "vehicle 'mein' is unknown; did you mean './mein.yaml'?; known: "),
    ('--vehicle', 'mein.yml', "vehicle 'mein.yml' is unknown; did you mean './mein.yaml'?; known: "),
    ('--route', 'way', "route 'way' is unknown; did you mean './way.gpx'?; known: ")])
def test_a_name_beside_its_file_is_named(tmp_path, refused, option, name, problem):
    for file in ('mein.yaml', 'way.gpx', 'meins.yaml'):
        (tmp_path / file).touch()
    assert problem in refused('plan', *SITUATION, option, name)


@pytest.mark.parametrize('columns, is_log', [
    ('time_s,battery_temperature_c,soc,power_w', True), ('time_s,length_m,height_m,power_w', False)])
def test_a_drive_log_given_as_a_route_is_named(tmp_path, said, columns, is_log):
    path = tmp_path / 'drive.csv'
    path.write_text('\n'.join([columns, *(f'{second},-3.5,0.8,8000' for second in range(200))]))
    status, _, errors = said('plan', *SITUATION, '--route', str(path))
    lines = errors.splitlines()
    assert status == 2
    hint = (f'{path}: is a drive log, no route; to make a route: preheat route --log {path} '
            '--vehicle NAME --output ROUTE.csv')
    assert any(hint in line for line in lines) == is_log
    assert any('a route needs ' in line for line in lines) != is_log


def completions(line):
    """Return the shell's completions of a line, by the protocol of argcomplete."""
    reader, writer = os.pipe()
    script = f'exec "$@" 8>&{writer} 9>/dev/null'
    subprocess.run(
        ['bash', '-c', script, 'bash', sys.executable, '-m', 'bev_preheat'], pass_fds=[writer],
        timeout=60, check=False, stdout=subprocess.DEVNULL, env=dict(
            os.environ, _ARGCOMPLETE='1', _ARGCOMPLETE_IFS='\n', COMP_LINE=line, COMP_TYPE='9',
            COMP_POINT=str(len(line.encode()))))
    os.close(writer)
    with open(reader, encoding='utf-8') as offered:
        return set(offered.read().replace(' ', '').splitlines())


@pytest.mark.costly
@pytest.mark.parametrize('line, expected', [
    pytest.param('preheat ', set(SUBCOMMANDS) | {'--version'}, marks=pytest.mark.deep),
    pytest.param('preheat plan --ve', {'--vehicle'}, marks=pytest.mark.deep),
    pytest.param('preheat plan --vehicle ref', {'reference'}, marks=pytest.mark.deep),
    pytest.param('preheat plan --route al', {'alpine_pass'}, marks=pytest.mark.deep),
    pytest.param('preheat plan --method ', {'value_function', 'optimal_switch', 'paper'},
                 marks=pytest.mark.deep),
    ('preheat scenario nominal heater_d', {'heater_dead', 'heater_derated'})])
def test_the_shell_completes(line, expected):
    """Without the optional argcomplete there are no completions and no messages."""
    if importlib.util.find_spec('argcomplete') is None:
        expected = set()
    assert completions(line) >= expected


@pytest.mark.parametrize('kind, suffix, prefix, names', [
    ('scenarios', '.yaml', 'clock_', ['clock_back', 'clock_forward']), ('routes', '.csv', 'm', ['motorway_3h'])])
def test_names_of_a_kind_are_completed_then_files(monkeypatch, kind, suffix, prefix, names):
    # In place of the optional argcomplete.
    files = SimpleNamespace(FilesCompleter=lambda allowednames: lambda begun: [begun, *allowednames])
    monkeypatch.setitem(sys.modules, 'argcomplete', SimpleNamespace(completers=files))
    monkeypatch.setitem(sys.modules, 'argcomplete.completers', files)
    argument = ArgumentParser().add_argument('name')
    completed_by(kind, argument, suffix)
    assert argument.completer(prefix) == [*names, prefix, suffix]
