# SPDX-License-Identifier: Apache-2.0
"""Published charging times: curves fitted to them."""

from dataclasses import replace

from plain_car import CAPACITY_AH, constant, own_session, plain_car, VOLTAGE_V
import pytest
from refusals import problems_of

from bev_preheat.charging.published_time import describe_timed_car, warm_session
from bev_preheat.charging.stop import ChargingStop
from bev_preheat.planning.situation import BatteryState
from bev_preheat.vehicle.charging_curve import ChargingCurve
from bev_preheat.vehicle.data_sheet import DataSheet
from bev_preheat.vehicle.loading import vehicle_of_text
from bev_preheat.vehicle.writing import vehicle_text

ID4 = DataSheet('id4', 'nmc', charging_power_kw=135.0, usable_energy_kwh=77.0, gross_energy_kwh=82.0,
                nominal_voltage_v=352.0)
ATTO3 = DataSheet('atto 3', 'lfp', charging_power_kw=88.0, usable_energy_kwh=60.48, cells_in_series=126)
CURVE = ChargingCurve((0.0, 0.3, 0.7, 1.0), (135.0, 135.0, 70.0, 20.0), 30.0)


def test_a_warm_session_in_closed_form():
    vehicle = plain_car(limit=constant(-60e3))
    expected_s = 3600.0 * 0.7 * VOLTAGE_V * CAPACITY_AH / 60e3
    assert warm_session(vehicle).charging_time_s == pytest.approx(expected_s, rel=1e-6)
    assert warm_session(vehicle, (0.2, 0.55)).charging_time_s == pytest.approx(0.5 * expected_s, rel=1e-6)


@pytest.mark.parametrize('sheet', [
    replace(ID4, charging_time_10_80_min=29.0), replace(ID4, charging_time_10_80_min=45.0),
    replace(ATTO3, charging_time_10_80_min=44.0), replace(ATTO3, charging_time_10_80_min=32.5),
    replace(ID4, charging_time_10_80_min=36.0, charging_curves=(CURVE,)),
    replace(ID4, charging_time_10_80_min=34.0, charging_curves=(CURVE,))],
    ids=['full', 'steep', 'LFP', 'LFP, full', 'curve, less', 'curve, more'])
def test_a_session_takes_the_published_time(sheet):
    text = vehicle_text(sheet.name, describe_timed_car(sheet), 'preheat vehicle new')
    vehicle, published_s = vehicle_of_text(text, sheet.name), 60.0 * sheet.charging_time_10_80_min
    assert warm_session(vehicle).charging_time_s == pytest.approx(published_s, abs=0.5)
    # At a charger that never limits, in air of 20 degC.
    stop = ChargingStop(1e6, 0.8, 20.0, 0.0, vehicle.defaults.auxiliary_power_w)
    assert own_session(vehicle, stop, BatteryState(25.0, 0.1)).time_s == pytest.approx(published_s, rel=0.005)


@pytest.mark.parametrize('changes, problem', [
    ({'chemistry': 'nca', 'charging_time_10_80_min': 29.0},
     "--chemistry: 'nca' is not one of nmc, lfp; NCA is given as nmc"),
    ({'charging_time_10_80_min': 12.0}, '--charging-time-10-80-min: 12 min is too short: 70% of the energy at '
     '--charging-power-kw 135 kW take 24.0 min'),
    ({'charging_time_10_80_min': 240.0}, '--charging-time-10-80-min: 240 min does not fit --charging-power-kw '
     '135 kW; it must be '),
    ({'charging_time_10_80_min': 60.0, 'charging_curves': (CURVE,)}, '--charging-time-10-80-min: 60 min does not '
     'fit --charging-curve, which takes '),
    ({'charging_time_10_80_min': 0.53}, '--charging-time-10-80-min: 0.53 min is implausible; it must be 4 ... '
     '240 min; 0.53 h would be 31.8 min'),
    ({'charging_curves': (replace(CURVE, power_kw=(162.0, 162.0, 84.0, 24.0)),)},
     '--charging-curve: its maximum of 162 kW exceeds --charging-power-kw 135 kW')])
def test_a_time_that_cannot_be_is_refused_in_words(changes, problem):
    told, = problems_of(describe_timed_car, replace(ID4, **changes))
    assert told.startswith(problem)
