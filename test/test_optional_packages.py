# SPDX-License-Identifier: Apache-2.0
"""A missing package is reported in one line with its installation; setup installs only missing packages."""

from importlib import util
from pathlib import Path

import pytest

from bev_preheat import optional_packages
from bev_preheat.commands.main import main
from bev_preheat.optional_packages import is_installed, MissingPackage, require

SITUATION = ['--vehicle', 'reference', '--route', 'winter_commute', '--temperature', '-5', '--soc',
             '0.8']
CASADI = ('the Python package casadi, which solves the nonlinear program, is not installed; in the '
          'checkout, scripts/setup.bash nlp installs it; elsewhere: python3 -m pip install casadi')
DO_MPC = ('the Python package do-mpc, which is the benchmark of the nonlinear program, is not '
          'installed; in the checkout, scripts/setup.bash bench installs it; elsewhere: python3 -m pip install do-mpc')


@pytest.fixture
def without(monkeypatch):
    """Return a function that hides modules, installed or not."""
    def hide(*modules):
        monkeypatch.setattr(optional_packages, 'find_spec',
                            lambda name: None if name in modules else util.find_spec(name))
    return hide


def test_each_missing_package_is_named_with_what_to_type(without):
    without('casadi', 'do_mpc')
    with pytest.raises(MissingPackage) as refused:
        require('matplotlib', 'casadi', 'do_mpc')
    assert refused.value.problems == [CASADI, DO_MPC]


def test_nothing_is_said_of_what_is_there():
    require('matplotlib', 'psutil')
    assert is_installed('scipy')


@pytest.mark.parametrize('arguments', [
    ['optimum', *SITUATION], ['compare', *SITUATION], ['reproduce'], ['sweep', '--feasible', '1']],
    ids=lambda arguments: arguments[0])
def test_a_command_without_its_package_is_refused_in_one_line(without, capsys, arguments):
    without('casadi')
    assert main(arguments) == 2
    assert capsys.readouterr() == ('', f'preheat: error: {CASADI}\n')


# Packages that setup installs in addition to those of a ROS machine

@pytest.fixture
def deficit(monkeypatch, tmp_path):
    """Return a function: the output lines for a machine with these packages {name: version}."""
    spec = util.spec_from_file_location(
        'lacking_packages', Path(__file__).parents[1] / 'scripts' / 'lacking_packages.py')
    script = util.module_from_spec(spec)
    spec.loader.exec_module(script)
    for kind, text in (('', 'numpy==1.26.4\nrich==14.0.0\ncolcon-core==0.19.0\nsetuptools==79.0.1\n'),
                       ('-optional', '# solver\ncasadi==3.6.7\n'), ('-bench', 'do-mpc==4.6.5\n'),
                       ('-oldest', 'numpy==1.26.0\nrich==13.7.0\npytest-cov==4.0\n')):
        (tmp_path / f'requirements{kind}.txt').write_text(text)
    monkeypatch.setattr(script, 'SCRIPTS', tmp_path)

    def lines(present, capsys, *arguments):
        monkeypatch.setattr(script, 'installed', present.get)
        script.main(arguments)
        return capsys.readouterr().out.splitlines()
    return lines


UBUNTU = {'numpy': '1.26.4', 'rich': '13.7.1', 'colcon-core': '0.15.1', 'setuptools': '68.1.2'}


@pytest.mark.parametrize('changes, wanted', [
    ({'casadi': '3.6.7'}, []), ({}, ['casadi>=3.6.7,<=3.6.7']),
    # Compared as numbers, not as texts: 13.10 is newer than 13.7.
    ({'casadi': '3.6.7', 'rich': '13.10.0'}, []),
    ({'casadi': '3.6.7', 'rich': '13.6.9'}, ['rich>=13.7.0,<=14.0.0']),
    ({'casadi': '3.6.7', 'colcon-core': None}, ['colcon-core>=0,<=0.19.0']),
    # Newer versions cannot build Python packages of ROS 2.
    ({'casadi': '3.6.7', 'setuptools': '80.0.0'}, ['setuptools>=0,<=79.0.1'])])
def test_only_what_is_absent_or_too_old_is_installed(deficit, capsys, changes, wanted):
    assert deficit({**UBUNTU, **changes}, capsys) == wanted


def test_the_benchmark_needs_its_peer_too(deficit, capsys):
    assert deficit(UBUNTU, capsys, '--group', 'bench') == ['casadi>=3.6.7,<=3.6.7', 'do-mpc>=4.6.5,<=4.6.5']


def test_what_is_installed_must_not_be_replaced(deficit, capsys):
    assert deficit(UBUNTU, capsys, '--constraints') == [
        'colcon-core==0.15.1', 'numpy==1.26.4', 'rich==13.7.1', 'setuptools==68.1.2']


def test_numpy_stays_of_one_major_version(deficit, capsys):
    assert 'numpy<2' in deficit({**UBUNTU, 'numpy': '1.24.0'}, capsys, '--constraints')
