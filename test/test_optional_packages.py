# SPDX-License-Identifier: Apache-2.0
"""A missing package is reported in one line with its installation; setup installs only missing packages."""

from importlib import metadata, util
from pathlib import Path
import re

from package_groups import normal, packages_of, pins
from packaging.requirements import Requirement
import pytest

from bev_preheat import optional_packages
from bev_preheat.optional_packages import MissingPackage, require

ROOT = Path(__file__).parents[1]
SITUATION = ['--vehicle', 'reference', '--route', 'winter_commute', '--temperature', '-5', '--soc',
             '0.8']
CASADI = ('the Python package casadi, which solves the nonlinear program, is not installed; in the '
          'checkout, scripts/setup.bash nlp installs it; elsewhere: python3 -m pip install casadi')
SCIPY = ('the Python package scipy, which fits vehicles to logs and to the paper, is not installed; in the '
         'checkout, scripts/setup.bash identify installs it; elsewhere: python3 -m pip install scipy')


@pytest.fixture
def without(monkeypatch):
    def hide(*modules):
        monkeypatch.setattr(optional_packages, 'find_spec',
                            lambda name: None if name in modules else util.find_spec(name))
    return hide


def test_each_missing_package_is_named_with_what_to_type(without):
    without('casadi', 'scipy')
    with pytest.raises(MissingPackage) as refused:
        require('matplotlib', 'casadi', 'scipy')
    assert refused.value.problems == [CASADI, SCIPY]


@pytest.mark.parametrize('arguments', [
    ['optimum', *SITUATION], ['compare', *SITUATION], ['reproduce'], ['sweep', '--feasible', '1']],
    ids=lambda arguments: arguments[0])
def test_a_command_without_its_package_is_refused_in_one_line(without, refused, arguments):
    without('casadi')
    assert refused(*arguments) == CASADI


# Packages that setup installs in addition to those of a ROS machine

def scripts_module(name):
    spec = util.spec_from_file_location(name, ROOT / 'scripts' / f'{name}.py')
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


UBUNTU = {'numpy': '1.26.4', 'rich': '13.7.1', 'colcon-core': '0.15.1', 'setuptools': '68.1.2'}


@pytest.fixture
def deficit(monkeypatch, tmp_path, capsys):
    """Return a function: the output lines for UBUNTU with these changes {name: version}."""
    script = scripts_module('lacking_packages')
    for kind, text in (('', 'numpy==1.26.4\ncolcon-core==0.19.0\nsetuptools==79.0.1\nempy==4.2.1\n'),
                       ('-demo', 'rich==14.0.0\npygments==2.21.0\n'),
                       ('-test', 'pytest==9.2.0\niniconfig==2.3.1\n'),
                       ('-optional', '# solver\ncasadi==3.6.7  # nlp studies\nmcap==1.3.0  # demo\n'
                                     'asammdf==8.8.28  # logs wheels\nrosbags==0.11.9  # logs\n'
                                     'selenium==4.51.0\n'),
                       ('-oldest', 'numpy==1.26.0\nrich==13.7.0\npytest==7.4.4\npytest-cov==4.0\n')):
        (tmp_path / f'requirements{kind}.txt').write_text(text)
    monkeypatch.setattr(script, 'SCRIPTS', tmp_path)

    def lines(changes, *arguments):
        monkeypatch.setattr(script, 'installed', {**UBUNTU, **changes}.get)
        script.main(arguments)
        return capsys.readouterr().out.splitlines()
    return lines


@pytest.mark.parametrize('changes, words, wanted', [
    # Of builds.
    ({}, [], []), ({'numpy': None}, [], ['numpy>=1.26.0,<=1.26.4']),
    ({'colcon-core': None}, [], ['colcon-core>=0,<=0.19.0']),
    # Newer versions cannot build Python packages of ROS 2.
    ({'setuptools': '80.0.0'}, [], ['setuptools>=0,<=79.0.1']),
    # Of the program, too.
    ({'mcap': '1.3.0'}, ['demo'], []), ({}, ['demo'], ['mcap>=1.3.0,<=1.3.0']),
    # Compared as numbers, not as texts: 13.10 is newer than 13.7.
    ({'mcap': '1.3.0', 'rich': '13.10.0'}, ['demo'], []),
    ({'mcap': '1.3.0', 'rich': '13.6.9'}, ['demo'], ['rich>=13.7.0,<=14.0.0']),
    # Without asammdf, which has no wheel for the NumPy of the distribution.
    ({}, ['logs'], ['rosbags>=0.11.9,<=0.11.9']),
    # The tests need every group.
    ({}, ['test'], ['casadi>=3.6.7,<=3.6.7', 'mcap>=1.3.0,<=1.3.0', 'pytest>=7.4.4,<=9.2.0',
                    'rosbags>=0.11.9,<=0.11.9', 'selenium>=4.51.0,<=4.51.0']),
    # Installed packages must not be replaced.
    ({}, ['--constraints', 'demo'], [
        'colcon-core==0.15.1', 'numpy==1.26.4', 'rich==13.7.1', 'setuptools==68.1.2'])])
def test_setup_installs_only_what_is_absent_or_too_old(deficit, changes, words, wanted):
    assert deficit(changes, *words) == wanted


def test_numpy_stays_of_one_major_version(deficit):
    assert 'numpy<2' in deficit({'numpy': '1.24.0'}, '--constraints')


# The lists that setup installs

GROUPS = sorted({group for line in (ROOT / 'scripts' / 'requirements-optional.txt').read_text().splitlines()
                 if '==' in line for group in line.partition('#')[2].split()} - {'wheels'})


def test_a_package_in_several_lists_has_one_version():
    # The linters and the documentation want different versions of one package, and are never imported.
    lists = [pins(f'requirements{kind}.txt') for kind in ('', '-demo', '-optional', '-test')]
    for first in lists:
        for second in lists:
            assert {name: (version, second[name]) for name, version in first.items()
                    if second.get(name, version) != version} == {}


@pytest.mark.parametrize('module, package', optional_packages.PACKAGES.items())
def test_the_named_group_has_the_package(module, package):
    assert normal(package.name or module) in packages_of(package.group)


@pytest.mark.parametrize('group', ['test', *GROUPS])
def test_a_group_is_complete(group):
    """Its packages need nothing beyond it, by their own metadata."""
    listed = packages_of('demo', group)
    missing = {}
    for name in listed.keys() - pins('requirements.txt').keys():
        try:
            needs = metadata.distribution(name).requires or ()
        except metadata.PackageNotFoundError:
            # Another environment, such as a distribution, has other packages.
            continue
        for requirement in map(Requirement, needs):
            if (requirement.marker is None or requirement.marker.evaluate({'extra': ''})) and normal(
                    requirement.name) not in listed:
                missing.setdefault(name, []).append(requirement.name)
    assert missing == {}


def test_pip_and_setup_have_the_same_groups():
    """Each extra of setup.py is a group of that name, and the group has the packages of the extra."""
    extras = dict(re.findall(r"^    '(\w+)': \[(.*)\]", (ROOT / 'setup.py').read_text(), re.M))
    del extras['plot'], extras['test']
    assert sorted(extras) == [group for group in GROUPS if group not in ('demo',)]
    for group, requirements in extras.items():
        named = {re.match(r'[\w-]+', each).group().lower() for each in re.findall(r"'(.*?)'", requirements)}
        assert named <= packages_of('demo', group).keys()
