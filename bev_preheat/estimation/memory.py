# SPDX-License-Identifier: Apache-2.0
"""
What was learned of a car, in a small file, so that the next drive begins with it.

The file belongs to one vehicle file: its fingerprint stands in it, and what was learned of another
car, or of the same with other values, is not taken over.
"""

from dataclasses import dataclass
import json
import math
import os
from pathlib import Path
import tempfile

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.belief import FACTOR_BOUNDS, prior_factor_covariance
from bev_preheat.estimation.state import FACTOR_NAMES, FACTORS, PROPULSION

FORMAT = 1
# What a route's consumption was wrong by says nothing of the next route.
REMEMBERED = slice(0, PROPULSION - FACTORS.start)
NAMES = FACTOR_NAMES[REMEMBERED]
# Standard deviation that a night adds to each logarithm: a car changes a little.
OVERNIGHT = 0.01
LARGEST_FILE_BYTES = 100_000


@dataclass(frozen=True, eq=False)
class Learned:
    """Logarithms of the factors (5,) and their covariance (5, 5), in the order of `state`."""

    factors: np.ndarray
    covariance: np.ndarray


def learned_from(estimate):
    """Return what an Estimate has Learned of the car."""
    bounds = np.array([FACTOR_BOUNDS[index] for index in range(FACTORS.start, FACTORS.stop)])
    # A mean over filters that are at a bound may lie beyond it by rounding.
    factors = np.clip(estimate.mean[FACTORS], -bounds, bounds)
    covariance = estimate.covariance[FACTORS, FACTORS].copy()
    prior = prior_factor_covariance()
    route = PROPULSION - FACTORS.start
    factors[route] = 0.0
    covariance[route, :] = covariance[:, route] = 0.0
    covariance[route, route] = prior[route, route]
    # A car that was hardly seen wanders off; it is never less known than one never seen.
    shrink = np.sqrt(np.minimum(1.0, np.diag(prior) / np.diag(covariance)))
    return Learned(factors, covariance * np.outer(shrink, shrink))


def save_learned(path, fingerprint, learned):
    """
    Write what was Learned; whoever reads meanwhile, or after a crash, finds the old or the new file.

    Raises OSError where it cannot be written.
    """
    contents = {
        'format': FORMAT,
        'vehicle_file_sha256': fingerprint,
        'log_factors': dict(zip(NAMES, learned.factors[REMEMBERED].tolist())),
        'covariance': learned.covariance[REMEMBERED, REMEMBERED].tolist(),
    }
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(prefix=f'.{path.name}.', dir=path.parent)
    try:
        with os.fdopen(handle, 'w', encoding='utf-8') as file:
            json.dump(contents, file, indent=1)
            file.write('\n')
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def load_learned(path, fingerprint):
    """
    Return what was Learned of the car with this fingerprint; None where there is no file.

    Raises InvalidInput, naming file and problem, where it is damaged, or belongs to another car.
    """
    path = Path(path)
    if not path.exists():
        return None
    try:
        with open(path, encoding='utf-8') as file:
            contents = json.loads(file.read(LARGEST_FILE_BYTES))
    except (OSError, ValueError, RecursionError) as error:
        raise InvalidInput(f'{path}: cannot be read: {error}') from error
    if not isinstance(contents, dict) or contents.get('format') != FORMAT:
        raise InvalidInput(f'{path}: is not of format {FORMAT}')
    if contents.get('vehicle_file_sha256') != fingerprint:
        raise InvalidInput(f'{path}: was learned with another vehicle file')
    try:
        logs = np.array([contents['log_factors'][name] for name in NAMES], dtype=float)
        covariance = np.array(contents['covariance'], dtype=float)
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidInput(f'{path}: log_factors or covariance is damaged: {error}') from error
    _check(path, logs, covariance)
    factors, whole = np.zeros(len(FACTOR_NAMES)), prior_factor_covariance()
    factors[REMEMBERED] = logs
    whole[REMEMBERED, REMEMBERED] = covariance + OVERNIGHT**2 * np.eye(len(NAMES))
    return Learned(factors, whole)


def _check(path, logs, covariance):
    size = len(NAMES)
    bounds = [FACTOR_BOUNDS[FACTORS.start + index] for index in range(size)]
    for name, value, bound in zip(NAMES, logs, bounds):
        if not abs(value) <= bound:
            raise InvalidInput(f'{path}: log_factors.{name}: {value:g} is not allowed; it must be '
                               f'{-bound:g} ... {bound:g}')
    if covariance.shape != (size, size) or not np.isfinite(covariance).all():
        raise InvalidInput(f'{path}: covariance: must be {size} times {size} finite numbers')
    variances = np.diag(covariance)
    most = np.diag(prior_factor_covariance())[REMEMBERED] * (1.0 + 1e-6)
    symmetric = np.allclose(covariance, covariance.T, rtol=1e-6, atol=1e-15)
    if not symmetric or (variances > most).any() or (
            np.linalg.eigvalsh(covariance) < -1e-12).any():
        raise InvalidInput(f'{path}: covariance: is none, or more uncertain than knowing nothing '
                           f'(standard deviations {", ".join(_roots(variances))})')


def _roots(variances):
    return [f'{math.sqrt(value):.3g}' if value >= 0.0 else 'none' for value in variances]
