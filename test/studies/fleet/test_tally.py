# SPDX-License-Identifier: Apache-2.0
"""Statistics of a fleet: independent of order and unchanged by a file; means exact, quantiles to a bin."""

import json

import numpy as np
import pytest

from bev_preheat_studies.fleet.tally import (
    BIN_WIDTHS,
    groups_of,
    MORE_WH,
    QUANTITIES,
    SAVED_S,
    Tally,
    tally_from,
)


@pytest.fixture(scope='module')
def trips():
    """600 made-up trips: groups, values."""
    random = np.random.default_rng(5)
    return [(groups_of('car', random.uniform(-20.0, 9.0), random.uniform(10.0, 120.0)), {
        way: {**dict.fromkeys(QUANTITIES, random.uniform(0.0, 3000.0)),
              SAVED_S: random.normal(200.0 * factor, 300.0), MORE_WH: random.gamma(2.0, 400.0 * factor)}
        for factor, way in ((1.0, 'one'), (2.0, 'other'))}) for _ in range(600)]


def tally_of(trips):
    tally = Tally()
    tally.count([groups for groups, _ in trips], ('one', 'other'), np.array(
        [[list(values[way].values()) for way in ('one', 'other')] for _, values in trips]))
    return tally


def test_blocks_add_up_to_the_same_in_any_order(trips):
    whole = tally_of(trips)
    for order in ((0, 1, 2), (2, 0, 1)):
        added = Tally()
        for part in order:
            added.add(tally_of(trips[part::3]))
        assert added == whole


def test_a_tally_is_read_back_from_json(trips):
    tally = tally_of(trips)
    tally.left_out['not driven'] += 3
    again = tally_from(json.loads(json.dumps(tally.as_record())))
    assert again.as_record() == tally.as_record()
    assert again.bins == tally.bins and again.trips == tally.trips and again.left_out == tally.left_out


@pytest.mark.parametrize('way', ['one', 'other'])
def test_means_and_quantiles_are_those_of_the_trips(trips, way):
    tally = tally_of(trips)
    cold = groups_of('car', -7.0, 20.0)[2]
    assert cold == '-10 to -5 degC'
    for group in ('all', cold):
        for quantity in (SAVED_S, MORE_WH):
            values = np.array([own[way][quantity] for groups, own in trips if group in groups])
            assert tally.mean(way, group, quantity) == pytest.approx(values.mean(), abs=1e-3)
            for share in (0.05, 0.5, 0.95):
                # The share of trips up to the quantile is right, within a bin's width.
                found, width = tally.quantile(way, group, quantity, share), BIN_WIDTHS[quantity]
                assert (values <= found + width).mean() >= share >= (values <= found - width).mean()


def test_the_tally_of_ten_times_as_many_trips_is_not_larger(trips):
    tally = tally_of(trips)
    before = len(tally.sums), sum(map(len, tally.bins.values()))
    for _ in range(9):
        tally.add(tally_of(trips))
    assert (len(tally.sums), sum(map(len, tally.bins.values()))) == before
    assert tally.trips['all'] == 6000


@pytest.mark.parametrize('ambient_c, length_min, names', [
    (-15.01, 29.9, ('below -15 degC', 'below 30 min')), (-15.0, 30.0, ('-15 to -10 degC', '30 to 60 min')),
    (4.99, 89.9, ('0 to 5 degC', '60 to 90 min')), (5.0, 90.0, ('from 5 degC', 'from 90 min'))])
def test_edges_belong_to_the_upper_group(ambient_c, length_min, names):
    assert groups_of('x', ambient_c, length_min) == ('all', 'x', *names, ', '.join(names))


def test_a_group_without_trips_has_no_figures():
    assert (Tally().mean('one', 'all', SAVED_S), Tally().quantile('one', 'all', SAVED_S, 0.5)) == (None, None)
