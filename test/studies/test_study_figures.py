# SPDX-License-Identifier: Apache-2.0
"""The content of the figures of studies and drives."""

from dataclasses import dataclass
from types import SimpleNamespace

from matplotlib.colors import to_hex
import numpy as np
import pytest

from bev_preheat.drawing.palette import look_of
from bev_preheat.simulation.mismatch import Mismatch
from bev_preheat_studies.drawing.endurance_figure import make_endurance_figure
from bev_preheat_studies.drawing.robustness_figure import make_robustness_figure, make_trip_figure
from bev_preheat_studies.drawing.study_figure import make_study_figure
from bev_preheat_studies.optimality.gap_study import FEASIBLE, UNREACHABLE
from bev_preheat_studies.robustness.drives import DriveTrace


def texts(axis):
    return [text.get_text() for text in axis.get_legend().get_texts()]


@dataclass(frozen=True)
class Made:
    """The part of a method's result that the figure of a study uses."""

    gap_wh: float | None


def trip(minutes, outcome=FEASIBLE, **methods):
    return SimpleNamespace(outcome=outcome, duration_s=60.0 * minutes, methods=methods)


@pytest.fixture(scope='module')
def study():
    """Panels of an infeasible trip and three feasible trips; the paper's method reaches less on one."""
    return make_study_figure([
        trip(30, value_function=Made(1e-3), optimal_switch=Made(1e-3), paper=Made(4.0)),
        trip(50, value_function=Made(-0.5), optimal_switch=Made(80.0), paper=Made(None)),
        trip(70, value_function=Made(2.0), optimal_switch=Made(2.0), paper=Made(9.0)),
        trip(90, UNREACHABLE, value_function=Made(7.0), optimal_switch=Made(7.0), paper=Made(7.0)),
    ], ['value_function', 'optimal_switch', 'paper']).axes


def test_a_study_compares_the_feasible_trips(study):
    by_values = study[0].get_lines()[0]
    assert by_values.get_xydata().tolist() == [
        [1e-3, 0.0], [1e-3, pytest.approx(100 / 3)], [0.5, pytest.approx(200 / 3)], [2.0, 100.0]]


def test_a_plan_that_reaches_less_saves_nothing(study):
    assert texts(study[0]) == [
        'value_function (default)', 'optimal_switch (one switch)', 'paper, not comparable on 1']
    paper = study[0].get_lines()[2]
    assert paper.get_xdata().max() == 9.0
    assert paper.get_ydata().max() == pytest.approx(200 / 3)


def test_points_on_each_other_are_all_seen(study):
    by_values, switch, paper = study[1].get_lines()
    assert list(by_values.get_xdata()) == list(switch.get_xdata()) == [30.0, 50.0, 70.0]
    assert by_values.get_markersize() > switch.get_markersize() > paper.get_markersize()
    assert by_values.get_markerfacecolor() == 'none'
    assert len({line.get_marker() for line in (by_values, switch, paper)}) == 3


@pytest.mark.costly
def test_a_study_without_feasible_trips_can_be_drawn():
    figure = make_study_figure([], ['value_function'])
    figure.draw_without_rendering()
    assert ': 0 feasible trips' in figure.texts[0].get_text()


def drive(error_k, energy_wh, switch_ons):
    return SimpleNamespace(arrival_error_k=error_k, heating_energy_wh=energy_wh,
                           switch_ons=switch_ons, ran_empty=False)


@pytest.fixture(scope='module')
def robustness():
    results = [SimpleNamespace(informed=drive(0.0, 1000.0, 1), methods={
        'replanned_paper': drive(-0.1 - 0.02 * number, 900.0, 40 + number),
        'planner': drive(0.1, 1020.0, 1)}) for number in range(5)]
    return make_robustness_figure(results, ['replanned_paper', 'planner']).axes


def test_histograms_have_the_colours_of_their_methods_and_one_hatch_each(robustness):
    patches = [patch for patch in robustness[0].patches if patch.get_label() in (
        'published heuristic, re-planned', 'planner')]
    assert [to_hex(patch.get_edgecolor()).upper() for patch in patches] == [
        look_of('replanned_paper').colour.upper(), look_of('planner').colour.upper()]
    assert len({patch.get_hatch() for patch in patches}) == 2


def test_one_key_serves_all_panels(robustness):
    assert texts(robustness[3]) == [
        'published heuristic, re-planned', 'planner', 'required for 90 % of the trips',
        'required maximum (energy: of the mean)', 'published heuristic, re-planned: mean', 'planner: mean']
    assert all(axis.get_legend() is None for axis in robustness[:3])


def test_bins_are_round_and_few(robustness):
    edges = {round(float(x), 9) for patch in robustness[0].patches if patch.get_label() == 'planner'
             for x in patch.get_xy()[:, 0]}
    assert len(edges) <= 11
    assert all(round(10.0 * edge, 6).is_integer() for edge in edges)


def test_mean_energies_are_where_they_are(robustness):
    means = {line.get_label(): line.get_xdata()[0] for line in robustness[1].get_lines()}
    assert means['planner: mean'] == pytest.approx(2.0)
    assert means['published heuristic, re-planned: mean'] == pytest.approx(-10.0)


def test_a_trip_shows_what_was_true_on_arrival():
    instants = np.arange(0.0, 600.0)
    course = DriveTrace(instants, instants / 30.0, np.round(instants / 30.0), instants / 30.0,
                        np.full(600, 19.0), np.full(600, 4000.0))
    result = SimpleNamespace(number=3, mismatch=Mismatch(), methods={
        'planner': SimpleNamespace(arrival_error_k=-0.4)})
    battery, predicted, command = make_trip_figure(result, {'planner': course}, 20.0).axes
    assert 'true, 19.6 °C on arrival' in texts(battery)
    dot = next(line for line in predicted.get_lines() if line.get_marker() == 'o')
    assert (float(dot.get_xdata()[0]), dot.get_ydata()[0]) == (10.0, pytest.approx(19.6))
    assert command.get_ylim()[0] < 0.0 < 4.0 < command.get_ylim()[1]
    assert command.get_xlim() == (0.0, 10.0)


def test_a_soak_test_shows_the_longest_gap_in_each_second():
    commands = [(100.0 + second + share, 2000.0 * (second % 2), 0.01)
                for second in range(240) for share in (0.0, 0.3, 0.5)]
    memory, gaps, power = make_endurance_figure(
        commands, [(float(second), 80.0) for second in range(240)]).axes
    assert gaps.get_lines()[0].get_ydata()[1:] == pytest.approx(500.0)
    assert power.get_lines()[0].get_ydata()[:4].tolist() == [0.0, 2.0, 0.0, 2.0]
    assert power.get_xlabel() == 'time [min]'
    assert np.ptp(memory.get_ylim()) > 10.0


@pytest.mark.costly
@pytest.mark.parametrize('commands, samples', [
    ([], []), pytest.param([(3.0, 0.0, 0.1)], [(0.0, 80.0)], marks=pytest.mark.deep)])
def test_a_soak_test_that_ended_at_once_can_be_drawn(commands, samples):
    make_endurance_figure(commands, samples).draw_without_rendering()
