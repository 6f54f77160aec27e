# SPDX-License-Identifier: Apache-2.0
"""The example package of docs/how-to/own_method.md, installed by pip, through Python and the command line."""

import shutil
import subprocess
import sys

import installed_packages
import numpy as np
import pytest

import bev_preheat as bp
from bev_preheat.commands.main import main

STATE = bp.BatteryState(-7.0, 0.9)
SITUATION = ['--vehicle', 'reference', '--route', 'reference', '--temperature', '-7', '--soc', '0.9']
METHODS = 'last_10_minutes', 'last_20_minutes', 'last_30_minutes'
pytestmark = pytest.mark.costly


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return the folder into which pip has installed the example, from a copy: a build leaves files behind."""
    source, folder = tmp_path_factory.mktemp('source') / 'example', tmp_path_factory.mktemp('installed')
    shutil.copytree(installed_packages.EXAMPLES / 'fixed_minutes_method', source)
    subprocess.run([sys.executable, '-m', 'pip', 'install', '-q', '--no-deps', '--no-build-isolation', '--target',
                    str(folder), str(source)], check=True, capture_output=True, text=True)
    return folder


@pytest.fixture
def installed(folder, monkeypatch):
    installed_packages.use_folder(monkeypatch, folder)


def test_it_plans_in_python(installed, vehicle, route):
    assert bp.methods() == ('value_function', 'optimal_switch', 'paper', *METHODS)
    plan = bp.plan(vehicle, route, STATE, method='last_20_minutes')
    assert plan.heating_start_s == pytest.approx(route.total_duration_s - 1200.0)
    limit_w = vehicle.hvch.maximum_power_w - route.cabin_heating_power_w
    expected_w = np.where(route.time_s[1:] > route.total_duration_s - 1200.0 + 1e-6, limit_w, 0.0)
    np.testing.assert_allclose(plan.hvch_battery_power_w, expected_w)
    warm = bp.plan(vehicle, route, bp.BatteryState(26.0, 0.9), method='last_20_minutes')
    assert warm.heating_start_s is None


def test_without_the_package_there_is_no_such_method(capsys):
    with pytest.raises(SystemExit):
        main(['plan', *SITUATION, '--method', 'last_10_minutes'])
    assert ("'last_10_minutes' is not one of value_function, optimal_switch, paper; see"
            in capsys.readouterr().err)
