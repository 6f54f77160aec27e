# SPDX-License-Identifier: Apache-2.0
"""Units of time, thinned curves, ranges of axes, titles and legends."""

from matplotlib.cbook import is_math_text
from matplotlib.figure import Figure
import numpy as np
import pytest

from bev_preheat.drawing.figure import (
    draw_course,
    draw_steps,
    legend_above,
    literal,
    MOST_POINTS,
    save_figure,
    show_range,
    stacked_figure,
    TimeAxis,
)
from bev_preheat.drawing.palette import look_of, LOOKS


@pytest.fixture
def axis():
    return Figure().subplots()


@pytest.mark.parametrize('duration_s, unit, end', [
    (0.001, 's', 0.001), (180.0, 's', 180.0), (181.0, 'min', 181.0 / 60.0),
    (3600.0, 'min', 60.0), (14400.0, 'min', 240.0), (86400.0, 'h', 24.0)])
def test_time_is_in_the_unit_that_fits(axis, duration_s, unit, end):
    time = TimeAxis(duration_s)
    time.finish(axis, 0.0, duration_s)
    assert axis.get_xlabel() == f'trip time [{unit}]'
    assert axis.get_xlim() == (0.0, pytest.approx(end))


def test_a_step_is_level_between_its_edges(axis):
    line = draw_steps(axis, [0.0, 2.0, 5.0], [7.0, -1.0])
    assert line.get_xydata().tolist() == [[0.0, 7.0], [2.0, 7.0], [2.0, -1.0], [5.0, -1.0]]


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


def test_rounding_does_not_fill_an_axis(axis):
    show_range(axis, [25.0, 25.0 + 1e-9], least=5.0)
    low, high = axis.get_ylim()
    assert high - low > 5.0 and (low + high) / 2.0 == pytest.approx(25.0)


@pytest.mark.parametrize('power_kw', [0.0, 1e-6, 3.0, 250.0])
def test_the_axis_of_a_constant_power_starts_at_0(axis, power_kw):
    show_range(axis, [0.0], [power_kw] * 3, least=1.0)
    low, high = axis.get_ylim()
    # Just low enough to show a line at 0.
    assert -0.1 * (high - low) < low < 0.0 and high > max(power_kw, 1.0)


def test_ticks_have_no_offset():
    _, (axis,) = stacked_figure(1, 'title')
    axis.plot([0.0, 1.0], [1e6, 1e6 + 1.0])
    axis.figure.draw_without_rendering()
    assert axis.yaxis.get_offset_text().get_text() == ''


def test_a_near_bound_is_shown_and_a_far_one_does_not_flatten_the_curve(axis):
    assert show_range(axis, [0.0, 40.0], least=1.0, bounds=[[50.0, 60.0], [-300.0, -200.0]]) == [
        True, False]
    low, high = axis.get_ylim()
    assert high > 60.0 and -10.0 < low < 0.0


def test_a_bound_that_comes_near_once_does_not_flatten_the_curve(axis):
    assert show_range(axis, [0.0, 40.0], least=1.0, bounds=[[45.0, 900.0]]) == [True]
    assert 45.0 < axis.get_ylim()[1] < 80.0


NAMES = ('a$b', '$x$', r'$\frac{1}$', r'\$_{', 'a_b^c', 'naïve 路线', 'a\x01b', 'c\udcff', '%s {0}')


@pytest.mark.parametrize('suffix, beginning', [
    ('png', b'\x89PNG'), ('svg', b'<?xml'), ('pdf', b'%PDF')])
@pytest.mark.filterwarnings('error::UserWarning')
def test_any_name_can_be_a_title(tmp_path, suffix, beginning):
    path = tmp_path / f'x.{suffix}'
    save_figure(stacked_figure(1, '\n'.join(NAMES))[0], path)
    assert path.read_bytes().startswith(beginning)


@pytest.mark.parametrize('name', ['a$b', '$x$', r'\$', r'\\$y$'])
def test_dollars_are_no_formula(name):
    figure, _ = stacked_figure(1, name)
    text = figure.texts[0].get_text()
    assert text.replace(r'\$', '$') == name and not is_math_text(text)


def test_a_long_title_is_broken_and_a_very_long_one_cut():
    lines = literal('x' * 250 + ' y').split('\n')
    assert ''.join(lines).replace(' ', '') == 'x' * 250 + 'y' and max(map(len, lines)) <= 100
    assert literal('word ' * 2000).count('\n') < 10 and literal('word ' * 2000).endswith('…')


def test_a_title_with_a_long_name_is_not_cut_at_the_sides():
    figure, _ = stacked_figure(1, 'x' * 300)
    figure.draw_without_rendering()
    title = figure.texts[0].get_window_extent()
    assert title.x0 >= 0.0 and title.x1 <= figure.bbox.x1


def test_two_legends_above_a_panel_do_not_meet():
    figure, (axis,) = stacked_figure(1, 'title')
    left = axis.plot([0, 1], label='value_function: 25.0 °C, 72.6 %, 15.072 kWh, drawn over nlp')
    right = axis.plot([0, 1], label='target 25.0 °C') + axis.plot([1, 0], label='ambient')
    legend_above(axis, left, columns=1)
    first = axis.get_legend()
    legend_above(axis, right, side='right')
    figure.draw_without_rendering()
    boxes = [legend.get_window_extent() for legend in (first, axis.get_legend())]
    assert boxes[0].x1 < boxes[1].x0
    assert min(box.y0 for box in boxes) >= axis.get_window_extent().y1
    assert max(box.y1 for box in boxes) <= figure.texts[0].get_window_extent().y0


# Curves in one figure must differ in colour, in dashes (black and white) and in markers.
TOGETHER = (('value_function', 'optimal_switch', 'paper', 'nlp', 'without preheating'),
            ('planner', 'replanned_paper'), ('planner', 'without preheating'))


@pytest.mark.parametrize('methods', TOGETHER)
@pytest.mark.parametrize('feature', ['colour', 'dashes', 'marker'])
def test_methods_of_one_figure_are_told_apart(methods, feature):
    assert len({getattr(look_of(method), feature) for method in methods}) == len(methods)


def test_a_narrower_line_lies_over_a_wider_one():
    lines = sorted((look.line() for look in LOOKS.values()), key=lambda line: line['linewidth'])
    orders = [line['zorder'] for line in lines]
    assert orders == sorted(orders, reverse=True)


def test_a_plan_as_driven_looks_like_its_method():
    assert look_of('paper, driven') == look_of('paper') != look_of('value_function')
