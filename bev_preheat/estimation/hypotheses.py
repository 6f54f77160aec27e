# SPDX-License-Identifier: Apache-2.0
"""Hypotheses on faults of the heater and on the place of the sensor, run in parallel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from functools import lru_cache
import math
from typing import NamedTuple

import numpy as np

from bev_preheat.numerics import FloatArray
from bev_preheat.tunables import (
    FAILURE_S,
    FAULTY,
    LAG_DEVIATION,
    LEANING,
    LEANING_COURSE_K,
    LEANING_COURSE_S,
    LEAST_COURSE_K,
    LEAST_COURSE_S,
    LEAST_RISE,
    NAMED_FROM,
    NO_CONTRADICTION,
    NOMINAL_HEAT_LAG_S,
    OTHERS_ERROR,
    REPAIR_S,
    SUSPECT_FROM,
    TAKEN_BACK_BELOW,
    TIMES_AS_LIKELY,
    TOLD_FROM,
)


class Heater(Enum):
    """Response of the heater to its command."""

    ANSWERS = 'answers'
    DERATED = 'derated'
    DEAD = 'dead'
    STUCK_ON = 'stuck on'


# Share of the commanded power that the heater delivers. The last one heats with all the power left by the cabin,
# whatever the command.
SHARES = (1.0, 0.5, 0.25, 0.0, 1.0)
HEATERS = (Heater.ANSWERS, *(Heater.DERATED,) * 2, Heater.DEAD, Heater.STUCK_ON)
HEALTHY, STUCK = 0, len(SHARES) - 1
# Place of the sensor (`state`) in a car whose file does not describe it: core, shell, thin shell. Mean, standard
# deviation, prior probability; lag of the heat [s], and deviation of its logarithm.
PLACES = (0.0, 4.0, 8.0)
PLACE_DEVIATIONS = (0.1, 1.2, 2.0)
PLACE_WEIGHTS = (0.7, 0.2, 0.1)
PLACE_LAGS_S = (NOMINAL_HEAT_LAG_S, 150.0, 100.0)
PLACE_LAG_DEVIATIONS = (LAG_DEVIATION, 0.7, 0.7)
IDENTITY = np.eye(len(SHARES))

# Battery states arrive at few different intervals, usually one.
KEPT_TRANSITIONS = 8


def prior_weights(of_places: Sequence[float] | FloatArray = PLACE_WEIGHTS) -> FloatArray:
    """Return the probability of each hypothesis (heaters, places); `of_places` are those of the places."""
    heaters = np.full(len(SHARES), FAULTY / (len(SHARES) - 1))
    heaters[0] = 1.0 - FAULTY
    return np.outer(heaters, of_places)


@lru_cache(maxsize=KEPT_TRANSITIONS)
def transitions(duration_s: float) -> FloatArray:
    """Return the probability that a heater changes kind (row to column) within `duration_s` [s]; read-only."""
    fails = 1.0 - math.exp(-duration_s / FAILURE_S)
    repaired = 1.0 - math.exp(-duration_s / REPAIR_S)
    matrix: FloatArray = (1.0 - repaired) * IDENTITY
    matrix[:, 0] += repaired
    matrix[0, :] = fails / (len(SHARES) - 1)
    matrix[0, 0] = 1.0 - fails
    return matrix


def heater_power_w(command_w: float, limit_w: float) -> list[float]:
    """Return the power [W] of each heater hypothesis under a command; both are below 0 for a source that cools."""
    # Plain Python is faster than NumPy for this few numbers.
    nearest = max if limit_w < 0.0 else min
    return [*[nearest(share * command_w, limit_w) for share in SHARES[:STUCK]], limit_w]


class SuspectedFault(NamedTuple):
    """
    A probable fault that is not reported yet, with its evidence.

    Its probability and its share of the command (0 ... 1), the duration of the suspicion [s], the missing or
    uncommanded heat in that time [K], and the log-likelihood ratio of the battery's power in its favour; None:
    power is not known.
    """

    heater: Heater
    probability: float
    share: float
    lasts_s: float
    heat_k: float
    power_nats: float | None


class HeaterReport(NamedTuple):
    """The heater's response, its probability (0 ... 1), and the share of the command delivered (0 ... 1)."""

    heater: Heater
    probability: float
    share: float
    suspected: SuspectedFault | None = None


class Suspicion(NamedTuple):
    """
    Duration of the suspicion [s], the heat since then, and the rise of the temperature reading [K].

    `commanded_k` is the heat that was commanded, `uncommanded_k` the heat that the heater could have delivered
    without a command, `explained_k` all heat of a battery whose heater answers, `others_k` that of other heat
    sources, each as a temperature rise [K]. Of a chiller the last three count cooling. The suspicion began at an
    instant [ns], at a reading [deg C].
    """

    lasts_s: float = 0.0
    commanded_k: float = 0.0
    uncommanded_k: float = 0.0
    rise_k: float = 0.0
    explained_k: float = 0.0
    others_k: float = 0.0
    since_ns: int = 0
    from_c: float = 0.0


def is_suspect(weights: Sequence[float]) -> bool:
    """Return whether the weights (heaters,) make a fault at least as likely as a healthy heater."""
    return 1.0 - weights[HEALTHY] >= SUSPECT_FROM


def judge(weights: Sequence[float], before: HeaterReport | None, suspicion: Suspicion,
          support: Callable[[Heater], float] | None, others: float = 0.0) -> HeaterReport:
    """
    Return the HeaterReport for the weights (heaters,); `before` is the previous report.

    While no fault is reported, the report names a suspected one.

    `suspicion` is the Suspicion since `is_suspect` holds. `support` returns the log-likelihood ratio [nats] of the
    battery's power for a kind of heater; None: power is not known. `others` is the part of the healthy weight in
    which another heat source is faulty.
    """
    report = _report(weights, before, suspicion, support, others)
    if report.heater is not Heater.ANSWERS or not is_suspect(weights):
        return report._replace(suspected=None)
    fault, share, probability = _likeliest(weights)
    return report._replace(suspected=SuspectedFault(
        fault, probability, share, suspicion.lasts_s, _course_k(fault, share, suspicion),
        None if support is None else support(fault)))


def _likeliest(weights: Sequence[float], told: Heater = Heater.ANSWERS) -> tuple[Heater, float, float]:
    """Return the likeliest fault, its share of the command and its probability; prefer the reported one."""
    by_kind = dict.fromkeys(Heater, 0.0)
    for weight, own in zip(weights, HEATERS):
        by_kind[own] += weight
    fault = max((kind for kind in Heater if kind is not Heater.ANSWERS), key=by_kind.__getitem__)
    if told is not Heater.ANSWERS and by_kind[fault] < TIMES_AS_LIKELY * by_kind[told]:
        fault = told
    share = sum(weight * share for weight, share, kind in zip(weights, SHARES, HEATERS)
                if kind is fault) / by_kind[fault]
    return fault, share, by_kind[fault]


def _report(weights: Sequence[float], before: HeaterReport | None, suspicion: Suspicion,
            support: Callable[[Heater], float] | None, others: float) -> HeaterReport:
    healthy = weights[HEALTHY]
    # A fault may be certain before its kind is, or its source.
    faulty = 1.0 - healthy
    told = Heater.ANSWERS if before is None else before.heater
    if faulty < (TAKEN_BACK_BELOW if told is not Heater.ANSWERS else
                 NAMED_FROM if faulty + others >= TOLD_FROM else TOLD_FROM):
        return HeaterReport(Heater.ANSWERS, healthy, 1.0)
    fault, share, probability = _likeliest(weights, told)
    if told is not fault and not _has_evidence(fault, share, suspicion, support):
        return HeaterReport(told, healthy, 1.0) if before is None else before
    return HeaterReport(fault, probability, share)


def _has_evidence(fault: Heater, share: float, suspicion: Suspicion,
                  support: Callable[[Heater], float] | None) -> bool:
    """Return whether power, or temperature over a long time, shows a fault with this share of the command."""
    supported = 0.0 if support is None else support(fault)
    least_k, least_s = LEAST_COURSE_K, LEAST_COURSE_S
    if fault is not Heater.STUCK_ON and supported >= LEANING:
        least_k, least_s = LEANING_COURSE_K, LEANING_COURSE_S
    if fault is Heater.STUCK_ON:
        # The battery has to warm by more than by other sources and, unless the power shows the heater, by driving.
        needless_k = OTHERS_ERROR * abs(suspicion.others_k) + max(
            suspicion.others_k if supported >= LEANING else suspicion.explained_k, 0.0)
        if suspicion.rise_k - needless_k < LEAST_RISE * suspicion.uncommanded_k:
            return False
    return (_course_k(fault, share, suspicion) >= least_k and suspicion.lasts_s >= least_s
            and supported >= NO_CONTRADICTION)


def _course_k(fault: Heater, share: float, suspicion: Suspicion) -> float:
    """Return the missing or uncommanded heat of a fault with this share of the command [K]."""
    return (suspicion.uncommanded_k if fault is Heater.STUCK_ON
            else (1.0 - share) * suspicion.commanded_k)
