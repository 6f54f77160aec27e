# SPDX-License-Identifier: Apache-2.0
"""Comparison of a drive with its expectations, on records written by hand."""

from math import nan

import numpy as np
import pytest

import bev_preheat as bp
from bev_preheat.control.decision import Command
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.route import make_route
from bev_preheat.simulation.scenario import Expectations, load_scenario
from bev_preheat.simulation.scenario_drive import DriveRecord, evaluate, evaluate_chain, fill_phases, PhaseEnd
from bev_preheat.vehicle import load_vehicle

COMMANDS = [(0.0, 0.0, 'WAITING'), (10.0, 5000.0, 'HEATING'), (20.0, 5000.0, 'HEATING'),
            (30.0, 0.0, 'STALE_INPUT'), (40.0, 3000.0, 'HEATING'), (50.0, 0.0, 'ARRIVED')]


def a_record(arrival_c=25.3, seen_heater='answers'):
    record = DriveRecord(25.0, list(COMMANDS), {'WAITING', 'HEATING', 'STALE_INPUT', 'ARRIVED'},
                         arrival_c=arrival_c, hottest_heated_c=31.0,
                         by_source=[Command(power_w, 0, Status[reason]) for _, power_w, reason in COMMANDS])
    for instant_s, regime, verdict, doubted in (
            (0.0, 'driving', 'answers', ()), (20.0, 'driving', 'answers', ('current',)),
            (30.0, 'standing', 'derated', ('current', 'source')), (40.0, 'driving', seen_heater, ()),
            (50.0, 'driving', seen_heater, ('current',))):
        record.regimes.append((instant_s, regime))
        record.note_heaters(instant_s, verdict, {})
        record.note_signals(instant_s, doubted)
    return record


def found(arrival_c=25.3, seen_heater='answers', **expected):
    record = a_record(arrival_c, seen_heater)
    finding, = evaluate(Expectations(**expected), record)
    return finding


@pytest.mark.parametrize('expected, good', [
    ({'arrival_error_k': (-0.5, 1.0)}, True), ({'arrival_error_k': (-0.5, 0.2)}, False),
    ({'arrival_error_k': (0.4, 1.0)}, False),
    # It never arrived.
    ({'arrival_c': nan, 'arrival_error_k': (-100.0, 100.0)}, False),
    ({'most_switch_ons': 2}, True), ({'most_switch_ons': 1}, False),
    ({'statuses': ('WAITING', 'ARRIVED')}, True), ({'statuses': ('WAITING', 'CHARGING')}, False),
    ({'never': ('INTERNAL_ERROR',)}, True), ({'never': ('STALE_INPUT',)}, False),
    ({'off_during': ((30.0, 40.0),)}, True), ({'off_during': ((30.0, 40.1),)}, False),
    ({'heats_during': ((0.0, 11.0),)}, True), ({'heats_during': ((0.0, 10.0),)}, False),
    # After the last command no expectation on heat holds.
    ({'off_during': ((60.0, 70.0),)}, False), ({'heats_during': ((60.0, 70.0),)}, False),
    ({'heater': 'answers'}, True), ({'heater': 'dead'}, False),
    ({'never_heater_verdict': True}, False),
    ({'not_heated_above_c': 31.0}, True), ({'not_heated_above_c': 30.9}, False),
    ({'regime_during': (('driving', 0.0, 30.0),)}, True), ({'regime_during': (('driving', 0.0, 30.1),)}, False),
    ({'regime_during': (('standing', 30.0, 40.0),)}, True), ({'regime_during': (('driving', 60.0, 70.0),)}, False),
    ({'never_regimes': ('charging', 'unknown')}, True), ({'never_regimes': ('charging', 'standing')}, False),
    ({'signals': ('source',), 'named_within_s': 30.0}, True),
    ({'signals': ('source',), 'named_within_s': 29.9}, False),
    ({'signals': ('source',)}, True), ({'signals': ('feed',)}, False), ({'no_signals': True}, False)])
def test_each_expectation_is_held_against_the_drive(expected, good):
    assert found(**expected).good is good


def test_each_heat_source_counts_its_own_switch_ons():
    record = DriveRecord(25.0)
    powers_w = (0.0, 0.0), (0.0, 800.0), (5000.0, 800.0), (5000.0, 0.0), (0.0, 700.0)
    for at, (hvch_w, pump_w) in enumerate(powers_w):
        record.note_command(10.0 * at, Command(hvch_w, 0, Status.HEATING, (('heat_pump', pump_w),)), 5.0)
    # The heater once; the heat pump twice, once while the heater ran.
    assert record.switched_on_s == [10.0, 20.0, 40.0]
    assert [power_w for _, power_w, _ in record.commands] == [0.0, 800.0, 5800.0, 5000.0, 700.0]
    assert record.during(20.0, 60.0, 25.0, nan).switched_on_s == [0.0, 0.0, 20.0]
    [finding] = evaluate(Expectations(most_switch_ons=2), record)
    assert (finding.seen, finding.good) == ('3', False)


def test_what_is_seen_is_said():
    finding = found(arrival_error_k=(-0.5, 0.2))
    assert (finding.expected, finding.seen) == ('-0.5 ... +0.2', '+0.30')
    assert found(statuses=('CHARGING', 'WAITING')).seen == 'all but CHARGING'
    assert found(never=('STALE_INPUT', 'CHARGING')).seen == 'STALE_INPUT'


def test_a_heater_and_signals_of_which_nothing_is_said_are_good():
    record = DriveRecord(25.0)
    record.note_heaters(0.0, 'answers', {})
    record.note_signals(0.0, ())
    assert [finding.good for finding in evaluate(
        Expectations(never_heater_verdict=True, no_signals=True), record)] == [True, True]


def test_a_phase_is_held_against_what_was_seen_in_it():
    # Its phases: drive, charge, park, drive; the clock of the chain does not jump.
    scenario = load_scenario('stood_after_charging')
    record = a_record()
    fill_phases(record, scenario, [PhaseEnd(0.0, 20.0, 24.0), PhaseEnd(20.0, 35.0, nan),
                                   PhaseEnd(35.0, 38.0, nan), PhaseEnd(38.0, 60.0, 25.5)])
    first, charged, parked, last = record.phases
    assert (first.arrival_c, last.arrival_c, record.arrival_c) == (24.0, 25.5, 24.0)
    assert (first.switch_ons, charged.commands) == (1, [(0.0, 5000.0, 'HEATING'), (10.0, 0.0, 'STALE_INPUT')])
    assert charged.regimes == [(0.0, 'driving'), (10.0, 'standing')]
    assert charged.signals == [(0.0, 'current'), (10.0, 'source')]
    # A verdict on the heater holds until the next one.
    assert parked.heater_verdicts == [(0.0, 'derated')]
    assert last.heater_verdicts == [(0.0, 'derated'), (2.0, 'answers')]
    findings = evaluate_chain(Expectations(), (None, Expectations(most_switch_ons=0), None, Expectations(
        arrival_error_k=(0.4, 0.6))), record)
    assert [(finding.what, finding.good) for finding in findings] == [
        ('phase 2: heater switched on [times]', False), ('phase 4: arrival error [K]', True)]


def test_a_chain_that_never_came_to_its_end_is_no_good():
    finding, = evaluate_chain(Expectations(), (None, None), DriveRecord(25.0))
    assert (finding.what, finding.expected, finding.seen, finding.good) == ('phases', '2', '0', False)


TARGET_C = 14.0


def test_a_drive_heats_by_the_commands_of_its_instants():
    vehicle = load_vehicle('reference')
    route = make_route({'duration_s': [30.0] * 20, 'speed_mps': [15.0], 'propulsion_power_w': [15e3],
                        'ambient_temperature_c': [-5.0]}, vehicle.defaults)
    drive = bp.drive(vehicle, route, BatteryState(8.0, 0.8), TARGET_C)
    known = ~np.isnan(drive.measured_temperature_c)
    assert known.sum() > 500
    assert drive.measured_temperature_c[known] == pytest.approx(drive.true_temperature_c[known], abs=0.3)
    assert (drive.command_w[drive.time_s < 600.0] > 0.0).any()
    # The command of an instant is in effect from then on.
    energy_wh = drive.command_w[:-1] @ np.diff(drive.time_s) / 3600.0
    assert drive.heating_energy_wh == pytest.approx(energy_wh, rel=0.02)
    assert abs(drive.arrival_error_k) < 0.5 and drive.arrival_soc > 0.0
    assert 0.0 < drive.heating_energy_wh < drive.battery_energy_wh
