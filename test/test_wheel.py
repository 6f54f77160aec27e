# SPDX-License-Identifier: Apache-2.0
"""The wheel: built, also without the studies, and run without ROS and without the checkout."""

from importlib.metadata import distribution
import json
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ['pyproject.toml', 'setup.py', 'setup.cfg', 'MANIFEST.in', 'package.xml', 'README.md', 'LICENSE',
           'CHANGELOG.rst', 'bev_preheat', 'studies', 'config', 'core', 'resource', 'launch']
SITUATION = ['--vehicle', 'reference', '--route', 'reference', '--temperature', '-7', '--soc', '0.9']
CHARGER = ['--charger-power', '150000', '--departure-soc', '0.8']
pytestmark = pytest.mark.costly


def requirements_of(name, found):
    """Collect the distributions that a distribution requires, without extras."""
    if name.lower() in found:
        return
    found[name.lower()] = needed = distribution(name)
    for requirement in needed.requires or ():
        if 'extra ==' not in requirement and 'python_version <' not in requirement:
            requirements_of(re.match(r'[\w.-]+', requirement).group(), found)


def link_packages(folder, names):
    """Link the installed files of distributions into a folder: the only other imports of the wheel."""
    found = {}
    for name in names:
        requirements_of(name, found)
    for each in found.values():
        for top in {path.parts[0] for path in each.files or () if path.parts[0] not in ('..', '__pycache__')}:
            source, link = Path(each.locate_file(top)), folder / top
            if source.exists() and not link.exists():
                link.symlink_to(source)


def build(sources, folder, compiler):
    environment = {key: value for key, value in os.environ.items()
                   if key not in ('COLCON', 'PYTHONPATH', 'AMENT_PREFIX_PATH')}
    # As pip does it, without loading pip.
    subprocess.run([sys.executable, '-c', 'import sys; from setuptools.build_meta import build_wheel; '
                    'build_wheel(sys.argv[1])', str(folder)], check=True, capture_output=True, text=True,
                   cwd=sources, env={**environment, 'CC': str(compiler)})
    wheel, = folder.glob('*.whl')
    return wheel


@pytest.fixture(scope='module')
def sources(tmp_path_factory):
    """Return a copy of the sources, because a build leaves files in them."""
    folder = tmp_path_factory.mktemp('sources')
    for name in SOURCES:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns('__pycache__', '*.so'))
        else:
            shutil.copy(source, folder / name)
    return folder


@pytest.fixture(scope='module')
def site(sources, tmp_path_factory):
    """Return a folder with only the unpacked wheel and the packages that it needs."""
    # Optimising the core takes most of a build's time; make build does it, and test/native tests the result.
    (compiler := tmp_path_factory.mktemp('compiler') / 'cc').write_text(
        f'#!/bin/sh\nexec {os.environ.get("CC", "cc")} "$@" -O0\n')
    compiler.chmod(0o755)
    wheel = build(sources, tmp_path_factory.mktemp('wheel'), compiler)
    folder = tmp_path_factory.mktemp('site')
    shutil.unpack_archive(wheel, folder, 'zip')
    link_packages(folder, ['argcomplete', 'jsonschema', 'numpy', 'PyYAML', 'rich'])
    return folder


# Runs commands of preheat, [[word, ...], ...], in one process; prints [[status, output, errors], ...].
COMMANDS = """
import contextlib, io, json, sys
from bev_preheat.commands.main import main
answers = []
for words in json.loads(sys.argv[1]):
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        try:
            status = main(words)
        except SystemExit as end:
            status = end.code
    answers.append([status, output.getvalue(), errors.getvalue()])
print(json.dumps(answers))
"""


def run(site, *words):
    """Run Python with only the site's packages."""
    return subprocess.run([sys.executable, '-S', *words], capture_output=True, text=True, cwd=site,
                          env={'PATH': os.environ['PATH'], 'PYTHONPATH': str(site), 'HOME': str(site)})


SHOWN = {
    'plan': (SITUATION, 'Heating starts in 32:02 min'),
    'worth': ([*SITUATION, *CHARGER], 'saves 2:17 min'),
    'charge': ([*SITUATION, *CHARGER], '4:50 min less than without preheating'),
    'vehicle': (['check', 'reference'], 'nothing is marked as assumed'),
    'scenario': (['charge_in_percent'], '1 of 1 scenarios'),
    '--version': ([], 'preheat 0.3.0')}
LACKING = {
    'optimum': (SITUATION, 'the Python package casadi'), 'compare': (SITUATION, 'the Python package casadi'),
    'prepare': ([], 'ROS 2')}


@pytest.fixture(scope='module')
def answers(site):
    """Return {command: [exit status, output, errors]} of SHOWN and LACKING."""
    commands = {**SHOWN, **LACKING}
    done = run(site, '-c', COMMANDS, json.dumps([[name, *words] for name, (words, _) in commands.items()]))
    assert (done.returncode, done.stderr) == (0, '')
    return dict(zip(commands, json.loads(done.stdout), strict=True))


@pytest.mark.parametrize('command', SHOWN)
def test_the_commands_work_without_ros(answers, command):
    status, output, errors = answers[command]
    assert (status, errors) == (0, '')
    assert SHOWN[command][1] in re.sub(r'\s+', ' ', output)


@pytest.mark.parametrize('command', LACKING)
def test_what_is_missing_is_named_in_one_line(answers, command):
    status, output, errors = answers[command]
    assert (status, output) == (2, '')
    line, = errors.splitlines()
    assert LACKING[command][1] in line


def test_the_native_core_is_in_the_wheel_and_used(site):
    done = run(site, '-c', 'from bev_preheat.vehicle.core_library import core_in_words; print(core_in_words())')
    assert done.stdout.strip() == f'used: {site}/bev_preheat/vehicle/libbev_preheat_core.so'


def test_the_module_is_the_command(site):
    done = run(site, '-m', 'bev_preheat', '--version')
    assert (done.returncode, done.stdout, done.stderr) == (0, 'preheat 0.3.0\n', '')


def test_the_public_interface_works(site):
    done = run(site, '-c', (
        'import bev_preheat as bp; v = bp.load_vehicle("reference"); r = bp.load_route("legs/reference", v); '
        'print(bp.plan(v, r, bp.BatteryState(-7.0, 0.9)).status)'))
    assert (done.stdout.strip(), done.stderr) == ('WAITING', '')


@pytest.mark.deep
def test_without_a_compiler_python_plans_alone(sources, tmp_path):
    shutil.rmtree(sources / 'build', ignore_errors=True)
    wheel = build(sources, tmp_path, '/nonexistent/compiler')
    shutil.unpack_archive(wheel, tmp_path / 'site', 'zip')
    assert not list((tmp_path / 'site').rglob('*.so'))
    link_packages(tmp_path / 'site', ['argcomplete', 'jsonschema', 'numpy', 'PyYAML', 'rich'])
    done = run(tmp_path / 'site', '-m', 'bev_preheat', 'plan', *SITUATION)
    assert 'Heating starts in 32:02 min' in done.stdout


@pytest.mark.parametrize('without, packages', [
    # make build leaves the variable out.
    ('0', ['bev_preheat', 'bev_preheat_studies']),
    ('1', ['bev_preheat'])])
def test_the_studies_can_be_left_out(tmp_path, without, packages):
    subprocess.run([sys.executable, 'setup.py', '--quiet', 'egg_info', '--egg-base', str(tmp_path)], cwd=ROOT,
                   env={**os.environ, 'BEV_PREHEAT_WITHOUT_STUDIES': without}, check=True, capture_output=True,
                   timeout=120)
    assert (tmp_path / 'bev_preheat.egg-info/top_level.txt').read_text().split() == packages
