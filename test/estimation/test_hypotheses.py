# SPDX-License-Identifier: Apache-2.0
"""Heater hypotheses: probabilities, powers, and reporting of faults."""

import numpy as np
import pytest

from bev_preheat.estimation.hypotheses import (
    Heater,
    HeaterReport,
    HEATERS,
    judge,
    SHARES,
    Suspicion,
    transitions,
)
from bev_preheat.tunables import (
    FAILURE_S,
    LEANING,
    LEAST_COURSE_K,
    LEAST_COURSE_S,
    LEAST_RISE,
    NO_CONTRADICTION,
    REPAIR_S,
    SUSPECT_FROM,
)

COUNT = len(SHARES)


def weights_of(**by_kind):
    """Return weights with a given sum for each kind of heater, evenly distributed within it."""
    kinds = {Heater[name.upper()]: weight for name, weight in by_kind.items()}
    kinds.setdefault(Heater.ANSWERS, 1.0 - sum(kinds.values()))
    return np.array([kinds.get(kind, 0.0) / HEATERS.count(kind) for kind in HEATERS])


def test_transitions_of_two_steps_are_those_of_both():
    # Exact except for heaters that fail and are repaired within one step.
    both = transitions(5.0) @ transitions(7.0)
    assert both == pytest.approx(transitions(12.0), abs=12.0**2 / FAILURE_S / REPAIR_S)


def test_faults_come_and_go_at_the_rates_that_are_said():
    matrix = transitions(1.0)
    assert matrix[0, 1:].sum() == pytest.approx(1.0 / FAILURE_S, rel=1e-3)
    assert matrix[1:, 0] == pytest.approx(np.full(COUNT - 1, 1.0 / REPAIR_S), rel=1e-3)


# Evidence specific to the fault

SHORT, LONG_OFF, LONG_ON = (
    Suspicion(60.0, 1.0, 1.0, 1.0), Suspicion(900.0, 0.0, 6.1, 5.0), Suspicion(900.0, 6.1, 0.0, 1.0))


def told(kind, suspicion, support):
    report = judge(weights_of(**{kind: 0.999}), None, suspicion,
                   None if support is None else lambda _: support)
    return report.heater is not Heater.ANSWERS


def changed(suspicion, **fields):
    """Return the suspicion with other fields."""
    return Suspicion(**{**dict(zip(Suspicion.__annotations__, suspicion, strict=True)), **fields})


@pytest.mark.parametrize('kind, suspicion, support', [
    *((kind, SHORT, support) for kind in ('dead', 'derated') for support in (20.0, None)),
    # Any other consumer would look the same as uncommanded heat.
    ('stuck_on', SHORT, 20.0), ('stuck_on', LONG_ON, 20.0)])
def test_power_alone_is_not_enough(kind, suspicion, support):
    assert not told(kind, suspicion, support)


@pytest.mark.parametrize('kind, suspicion', [('dead', LONG_ON), ('derated', LONG_ON), ('stuck_on', LONG_OFF)])
def test_temperature_alone_needs_a_long_course(kind, suspicion):
    assert told(kind, suspicion, None)
    # Of 6.1 K half is missing with the weakest plausible derated heater.
    assert 0.5 * 6.1 > LEAST_COURSE_K
    assert not told(kind, Suspicion(900.0, 0.45 * LEAST_COURSE_K, 0.9 * LEAST_COURSE_K, LEAST_COURSE_K), None)
    assert not told(kind, changed(suspicion, lasts_s=LEAST_COURSE_S - 1.0), None)


@pytest.mark.parametrize('kind, suspicion', [('dead', LONG_ON), ('derated', LONG_ON), ('stuck_on', LONG_OFF)])
def test_power_that_contradicts_a_fault_keeps_it_from_being_told(kind, suspicion):
    assert told(kind, suspicion, NO_CONTRADICTION + 0.1)
    assert not told(kind, suspicion, NO_CONTRADICTION - 0.1)


# 95 % name a source once a fault is certain, that is at 99.5 % for all sources together.
@pytest.mark.parametrize('own, others, is_named', [
    (0.996, 0.0, True), (0.99, 0.0, False), (0.96, 0.036, True), (0.96, 0.034, False), (0.94, 0.058, False)])
def test_a_certain_fault_is_that_of_the_source_that_it_is_most_likely_of(own, others, is_named):
    report = judge(weights_of(dead=own), None, LONG_ON, None, others)
    assert (report.heater is Heater.DEAD) == is_named


# Suspicion

# The derated heaters with half and with a quarter of the power are equally likely, so five eighths are missing.
@pytest.mark.parametrize('kind, heat_k', [('dead', 1.5), ('derated', 0.625 * 1.5), ('stuck_on', 0.4)])
def test_a_fault_is_suspected_with_its_evidence_until_it_is_told(kind, heat_k):
    suspicion = Suspicion(70.0, 1.5, 0.4, 0.0)
    weights = weights_of(**{kind: 0.8})
    report = judge(weights, None, suspicion, lambda fault: 1.25)
    assert report.heater is Heater.ANSWERS and report.probability == pytest.approx(0.2)
    suspected = report.suspected
    assert (suspected.heater.name.lower(), suspected.lasts_s, suspected.power_nats) == (kind, 70.0, 1.25)
    assert (suspected.probability, suspected.heat_k) == pytest.approx((0.8, heat_k))
    assert judge(weights, None, suspicion, None).suspected.power_nats is None
    # Unlikely faults and reported faults are not suspected.
    assert judge(weights_of(dead=SUSPECT_FROM - 0.01), None, suspicion, None).suspected is None
    assert judge(weights, HeaterReport(Heater.DEAD, 0.9, 0.0), suspicion, None).suspected is None


def test_uncommanded_heat_needs_a_reading_that_rises():
    # After a spike the reading falls back while the hypothesis is still likely.
    assert told('stuck_on', LONG_OFF, 5.0)
    assert not told('stuck_on', changed(LONG_OFF, rise_k=0.9 * LEAST_RISE * LONG_OFF.uncommanded_k), 5.0)


def test_warming_by_driving_is_no_fault_unless_the_power_shows_the_heater():
    # The reading rises by 5.0 K, and by all but 2.3 K without a fault; 40 % of 6.1 K are 2.4 K.
    explained = changed(LONG_OFF, explained_k=5.0 - 0.95 * LEAST_RISE * LONG_OFF.uncommanded_k)
    assert not told('stuck_on', explained, None) and not told('stuck_on', explained, 0.9 * LEANING)
    assert told('stuck_on', explained, 1.1 * LEANING)
    assert told('stuck_on', changed(explained, explained_k=2.0), None)
    # A battery that would have cooled has no more heat than it shows.
    assert not told('stuck_on', changed(LONG_OFF, rise_k=0.1, explained_k=-5.0), None)


@pytest.mark.parametrize('support, others_k, needless_k', [(5.0, 4.0, 1.3 * 4.0), (0.0, 4.0, 1.0 + 0.3 * 4.0),
                                                           (0.0, -4.0, 1.0 + 0.3 * 4.0)])
def test_heat_by_which_other_sources_may_differ_from_their_file_is_no_fault(support, others_k, needless_k):
    # 40 % of the heater's possible heat have to be seen beyond the others' heat, which is known within 30 %.
    least_k = needless_k + LEAST_RISE * LONG_OFF.uncommanded_k
    for rise_k, is_told in ((0.98 * least_k, False), (1.02 * least_k, True)):
        assert told('stuck_on', changed(
            LONG_OFF, rise_k=rise_k, explained_k=1.0, others_k=others_k), support) is is_told
