# SPDX-License-Identifier: Apache-2.0
"""Values that the planner learned on line, as a vehicle file."""

from __future__ import annotations

from dataclasses import replace
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import figure, InvalidInput
from bev_preheat.estimation.memory import LAG_NAMES, NAMES
from bev_preheat.estimation.prior import NOMINAL_LAGS_S, prior_factor_covariance
from bev_preheat.estimation.state_file import load_state
from bev_preheat.identification.curves import KNOTS_C, KNOTS_SOC, resistance_table
from bev_preheat.identification.deviations import with_deviations
from bev_preheat.identification.uncertainty import MOST_OF_PRIOR, QUANTILE
from bev_preheat.identification.vehicle_file import UNCERTAINTY_NOTE
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

if TYPE_CHECKING:
    from bev_preheat.estimation.prior import Learned
    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.vehicle.description import Vehicle

# Keys of the vehicle file that each learned factor changes, in the order of `estimation.memory.NAMES`.
KEYS = ('battery.heat_capacity_j_per_k', 'battery.leakage', 'battery.resistance', 'hvch.efficiency')


class LearnedVehicle(NamedTuple):
    """
    A Vehicle with learned values.

    Rows are (name, factor, low, high) with 90 % intervals; `notes` are comments by dotted key.
    """

    vehicle: Vehicle
    rows: tuple[tuple[str, float, float, float], ...]
    notes: dict[str, str]


def learned_vehicle(vehicle: Vehicle, fingerprint: str, state_file: AnyPath, name: str) -> LearnedVehicle:
    """
    Return the LearnedVehicle of a state file for the vehicle file with this fingerprint.

    Raises InvalidInput if the file is no state file, or if nothing was learned about this vehicle file.
    """
    recalled = load_state(state_file, fingerprint)
    learned = recalled.learned
    if learned is None:
        raise InvalidInput(f'--state-file: {state_file}: nothing learned about this vehicle file'
                           + (f' ({recalled.damage})' if recalled.damage else '')
                           + '; name the file with which the planner ran')
    factors = np.exp(learned.factors[:len(NAMES)]).tolist()
    spreads = np.exp(QUANTILE * np.sqrt(np.diag(learned.covariance)[:len(NAMES)])).tolist()
    rows = [(factor_name.replace('_', ' '), factor, factor / spread, factor * spread)
            for factor_name, factor, spread in zip(NAMES, factors, spreads)]
    if learned.lags is not None:
        lags_s = (NOMINAL_LAGS_S * np.exp(learned.lags.logs)).tolist()
        spreads_s = np.exp(QUANTILE * np.sqrt(learned.lags.variances)).tolist()
        rows += [(f'{lag_name} lag [s]', lag_s, lag_s / spread, lag_s * spread)
                 for lag_name, lag_s, spread in zip(LAG_NAMES, lags_s, spreads_s)]
    car = corrected_vehicle(vehicle, Corrections(*factors))
    log_resistance = np.full(len(KNOTS_C), math.log(factors[2]))
    car = replace(car, name=name, battery=replace(
        car.battery, resistance=resistance_table(vehicle.battery, log_resistance, np.zeros(len(KNOTS_SOC)))),
        hvch=replace(car.hvch, efficiency=min(car.hvch.efficiency, 1.0)),
        uncertainty=with_deviations(vehicle.uncertainty, _narrower(learned)))
    notes = {key: f"learned on line: {figure(factor, 4)} times START's, 90 % interval "
                  f'{figure(low, 4)} ... {figure(high, 4)}'
             for key, (_, factor, low, high) in zip(KEYS, rows)}
    notes['uncertainty'] = UNCERTAINTY_NOTE
    return LearnedVehicle(car, tuple(rows), notes)


def _narrower(learned: Learned) -> dict[str, float]:
    """Return the standard deviations by factor that are narrower than without any drive."""
    variances, prior = np.diag(learned.covariance), np.diag(prior_factor_covariance())
    return {name: math.sqrt(variance) for name, variance, most in zip(NAMES, variances, prior)
            if variance < MOST_OF_PRIOR**2 * most}
