# SPDX-License-Identifier: Apache-2.0
"""Units of time, thinned curves, ranges of axes, titles and legends."""

from matplotlib.figure import Figure
import numpy as np
import pytest

from bev_preheat.drawing.figure import (
    draw_course,
    finish_panel,
    literal,
    MOST_POINTS,
    save_figure,
    show_range,
    stacked_figure,
)
from bev_preheat.drawing.palette import look_of


@pytest.fixture
def axis():
    return Figure().subplots()


def test_a_long_curve_is_thinned_and_keeps_its_ends_and_extremes(axis):
    values = np.sin(np.arange(100_000) * 0.37)
    values[[31_415, 92_653]] = 9.0, -8.0
    values[0], values[-1] = 0.5, 0.25
    x, y = draw_course(axis, np.arange(100_000.0), values).get_data()
    assert len(x) <= MOST_POINTS + 2
    assert (x[0], y[0], x[-1], y[-1]) == (0.0, 0.5, 99_999.0, 0.25)
    assert (x[np.argmax(y)], y.max(), x[np.argmin(y)], y.min()) == (31_415.0, 9.0, 92_653.0, -8.0)


def test_a_gap_of_a_long_curve_stays_one(axis):
    values = np.zeros(50_000)
    values[20_000:30_000] = np.nan
    x, y = draw_course(axis, np.arange(50_000.0), values).get_data()
    assert np.isnan(y[(x > 21_000) & (x < 29_000)]).all()
    assert np.isfinite(y[(x < 19_000) | (x > 31_000)]).all()


def test_a_near_bound_is_shown_and_a_far_one_does_not_flatten_the_curve(axis):
    assert show_range(axis, [0.0, 40.0], least=1.0, bounds=[[50.0, 60.0], [-300.0, -200.0]]) == [
        True, False]
    low, high = axis.get_ylim()
    assert high > 60.0 and -10.0 < low < 0.0


def test_the_legend_says_where_a_far_line_lies(axis):
    levels = [axis.axhline(height, label=f'limit {height} °C') for height in (44, 90, -90)]
    finish_panel(axis, 'temperature', [0.0, 40.0], least=1.0, levels=levels)
    assert [text.get_text() for text in axis.get_legend().get_texts()] == [
        'limit 44 °C', 'limit 90 °C (above this range)', 'limit -90 °C (below this range)']


NAMES = ('a$b', '$x$', r'$\frac{1}$', r'\$_{', 'a_b^c', 'naïve 路线', 'a\x01b', 'c\udcff', '%s {0}')


@pytest.mark.parametrize('suffix, beginning', [
    ('png', b'\x89PNG'), ('svg', b'<?xml'), ('pdf', b'%PDF')])
@pytest.mark.filterwarnings('error::UserWarning')
def test_any_name_can_be_a_title(tmp_path, suffix, beginning):
    path = tmp_path / f'x.{suffix}'
    save_figure(stacked_figure(1, '\n'.join(NAMES))[0], path)
    assert path.read_bytes().startswith(beginning)


def test_a_long_title_is_broken_and_a_very_long_one_cut():
    lines = literal('x' * 250 + ' y').split('\n')
    assert ''.join(lines).replace(' ', '') == 'x' * 250 + 'y' and max(map(len, lines)) <= 100
    assert literal('word ' * 2000).count('\n') < 10 and literal('word ' * 2000).endswith('…')


# Curves in one figure must differ in colour, in dashes (black and white) and in markers.
TOGETHER = (('value_function', 'optimal_switch', 'paper', 'nlp', 'without preheating'),
            ('planner', 'replanned_paper'), ('planner', 'without preheating'))


@pytest.mark.parametrize('methods', TOGETHER)
@pytest.mark.parametrize('feature', ['colour', 'dashes', 'marker'])
def test_methods_of_one_figure_are_told_apart(methods, feature):
    assert len({getattr(look_of(method), feature) for method in methods}) == len(methods)
