# SPDX-License-Identifier: Apache-2.0
"""The study of heating at the charger: its choice costs no more than always and never, and its table says so."""

import json
import math

import pytest

from bev_preheat_studies.charger_heating import CHARGERS_W, HeatedStop, main, row


def stop(always, never, chosen, decision='limited'):
    return HeatedStop(0, 'car', 11e3, -5.0, 0.0, decision, always, never, chosen, 600.0)


def test_one_car_at_each_charger_and_the_choice_costs_no_more_than_the_better_of_both(tmp_path, capsys):
    assert main(['--cars', '1', '--seed', '3', '--json', str(tmp_path / 'a.json')]) == 0
    assert 'more than the better of both in 0 of 4 stops' in capsys.readouterr().out
    stops = json.loads((tmp_path / 'a.json').read_text())['stops']
    assert [each['charger_w'] for each in stops] == list(CHARGERS_W)
    assert len({(each['vehicle'], each['ambient_c'], each['arrival_c']) for each in stops}) == 1
    for each in stops:
        # JSON has no infinity.
        others = [cost for cost in (each['always'], each['never']) if cost is not None]
        assert each['chosen'] <= min(others) * (1.0 + 1e-9)
        assert each['arrival_c'] >= each['ambient_c'] and each['chosen_s'] > 0.0


def test_a_row_has_the_decisions_and_the_excess_in_percent():
    endless = math.inf
    cells = row(11e3, [stop(12.0, 15.0, 10.0), stop(10.0, endless, 10.0, 'always'),
                       stop(11.0, 10.0, 10.0, 'never'), stop(endless, endless, endless)])
    # Always: 20, 0 and 10 %; never: 50 and 0 %; the better: 20, 0 and 0 %. One ends only heated.
    assert cells == ('11 kW', '3', '1', '1', '1', '10.00', '20.0', '25.00', '50.0', '0.00', '20.0', '1')


def test_a_charger_at_which_no_session_ends_has_no_figures():
    assert row(50e3, [stop(math.inf, math.inf, math.inf)]) == ('50 kW', '0', '0', '0', '0', *'––––––', '0')


@pytest.mark.parametrize('arguments, problem', [
    (['--cars', '0'], '--cars: 0 is not allowed; it must be 1 ... 100000'),
    (['--seed', '-1'], '--seed: -1 is not allowed')])
def test_arguments_that_are_not_allowed_are_named(arguments, problem, capsys):
    assert main(arguments) == 2
    assert problem in capsys.readouterr().err
