# SPDX-License-Identifier: Apache-2.0
"""The study of uncertain charging: the best target against a search over start and end of heating."""

from dataclasses import asdict
import json
import math

import numpy as np
import pytest

from bev_preheat.charging.prospect import ChargingProspect
from bev_preheat_studies.charging_probability.brute_force import (
    between,
    compare,
    COMPARED,
    Gap,
    gap_from,
    Judge,
    run_gaps,
)
from bev_preheat_studies.charging_probability.closed_loop import Driven, driven_from, Outcome, run_drives
from bev_preheat_studies.kept_results import Kept
from bev_preheat_studies.optimality.charging_trips import draw_charging_trip


@pytest.mark.costly
@pytest.mark.parametrize('number', [
    pytest.param(10, id='even chance'), pytest.param(2, id='with a heat path', marks=pytest.mark.deep),
    pytest.param(43, id='nearly certain', marks=pytest.mark.deep)])
def test_the_best_target_costs_no_more_than_the_search_finds(number):
    gap = compare(1, number)
    assert gap.outcome == COMPARED
    # Heating pays on these drives.
    assert gap.cost < gap.unheated_cost * 0.98
    assert gap.gap <= 1e-3


def test_the_search_keeps_the_reserve():
    """The unheated battery arrives with 2.9 %; less than that is not left for heat."""
    drawn = draw_charging_trip(1, 42)
    judge = Judge(drawn, ChargingProspect(0.84))
    end_s = drawn.route.total_duration_s
    assert judge.allows(between(end_s - 1.0, end_s)) is False
    assert not judge.allows(between(0.0, end_s))


def test_the_expected_cost_is_linear_in_the_chance():
    drawn = draw_charging_trip(1, 10)
    heating = between(0.5 * drawn.route.total_duration_s, math.inf)
    costs = [Judge(drawn, ChargingProspect(probability)).cost(heating) for probability in (0.2, 0.5, 0.8)]
    assert np.diff(costs, 2) == pytest.approx(0.0, abs=1e-9)
    assert costs[2] > costs[0] > 0.0


@pytest.mark.parametrize('run, record_of', [
    (run_gaps, lambda: (Gap(0, COMPARED, '', ChargingProspect(0.3, 60.0), True, 2.0, 1.9, 3.0, 2.5), gap_from)),
    (run_drives, lambda: (Driven(0, Outcome(1.0, 0.2, 1), Outcome(1.5, 0.0, 0), (Outcome(1.1, 0.1, 1),)),
                          driven_from))], ids=['search', 'closed loop'])
def test_a_stopped_study_resumes_from_its_results(run, record_of):
    result, from_record = record_of()
    # As it is read back from a file.
    kept = from_record(json.loads(json.dumps(asdict(result))))
    reported = []
    run(1, 1, 1, reported.append, Kept({0: kept}))
    assert reported == [result]
