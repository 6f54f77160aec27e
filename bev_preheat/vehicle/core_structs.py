# SPDX-License-Identifier: Apache-2.0
"""
Structs of core.h and estimation.h, filled: a vehicle, the columns of a trip, and the terms of a belief.

An object here keeps alive all memory that its struct points to. `address` is the struct's.
"""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import addressof, c_double, c_int32, c_void_p, Structure
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bev_preheat.numerics import Curve, FloatArray
from bev_preheat.vehicle.curves import InverseTemperatureResistance, PolynomialVoltage, Table
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.model import hottest_c, TRIP_COLUMNS, TripColumns
from bev_preheat.vehicle.variants import ScaledCurve

ELEMENTS, BOUNDED, MOST_HEATERS = 15, 10, 16
MOST_AXIS = 1024
MOST_FACTORS = 4
PARAMETERS = 5
POLYNOMIAL, POLYNOMIAL_AND_LOGARITHM, INVERSE_TEMPERATURE, TABLE = range(4)
DOUBLE_BYTES = 8
VALUE_POINTS = 128
VALUE_KEPT_EVERY = 16
# Memory of the functions of core.h, doubles (flags: bytes) for each step of a trip, and once.
ROOMS = {
    'BEV_BELIEF_MEMORY': (1 + ELEMENTS + ELEMENTS * ELEMENTS, 0),
    'BEV_SWITCH_MEMORY': (8, 8),
    'BEV_TWO_SWITCHES_MEMORY': (1, 1),
    'BEV_VALUE_BYTES': (4, 0),
    'BEV_VALUE_MEMORY': (2 * VALUE_POINTS + 23, 2 * VALUE_POINTS + 16),
    'BEV_VALUE_SPARING_MEMORY': (
        2 * VALUE_POINTS // VALUE_KEPT_EVERY + 23, 2 * VALUE_POINTS * VALUE_KEPT_EVERY + 16)}


def room(name: str, steps: int) -> int:
    """Return how many numbers a function takes as memory for a trip; `name` is that of the macro in core.h."""
    for_each, once = ROOMS[name]
    return for_each * steps + once


def _each(kind: type[Any], names: str) -> list[tuple[str, type[Any]]]:
    """Return fields of one kind, named in a text."""
    return [(name, kind) for name in names.split()]


class CurveStruct(Structure):
    """`bev_curve`."""

    _fields_ = [*_each(c_int32, 'kind factor_count soc_count temperature_count'),
                ('parameter', c_double * PARAMETERS), ('factor', c_double * MOST_FACTORS),
                *_each(c_void_p, 'soc temperature_c values')]


class VehicleStruct(Structure):
    """`bev_vehicle`."""

    _fields_ = [
        *_each(c_double, 'capacity_ah heat_capacity_j_per_k lowest_c highest_c hottest_c heater_efficiency '
               'heat_share heater_lag_s coolant_heat_capacity_j_per_k coolant_conductance_w_per_k shell_share'),
        *_each(CurveStruct, 'open_circuit_voltage resistance charge_power_limit discharge_power_limit')]


class TripStruct(Structure):
    """`bev_trip`."""

    _fields_ = [('steps', c_int32), *((name, c_void_p) for name in (*TRIP_COLUMNS, 'sources'))]


class HeatSourcesStruct(Structure):
    """`bev_heat_sources`."""

    _fields_ = [
        *_each(c_int32, 'count heating_count temperature_count step_count'),
        *_each(c_void_p, 'temperature_c power_w hvch_watts taken_w steps_w drawing_limit_w cold_limit_w')]


class TripTermsStruct(Structure):
    """`bev_trip_terms`."""

    _fields_ = _each(c_double, 'gamma_0_w_per_k gamma_v_w_per_k_per_mps heat_share stiff_w_per_k heater_w '
                     'heater_share heat_lag_s')


class ValueGoalStruct(Structure):
    """`bev_value_goal`: the requirements of a plan by values."""

    _fields_ = [('direction', c_int32), *_each(c_double, 'target_c most_c lowest_soc deviation_k'),
                ('price', c_void_p)]


class StrandingStruct(Structure):
    """`bev_stranding`."""

    _fields_ = [('step', c_int32), ('driven_share', c_double)]


class RunOfPowersStruct(Structure):
    """`bev_run_of_powers`."""

    _fields_ = [('is_deliverable', c_int32),
                *_each(c_void_p, 'soc temperature_c heater_w arriving_heat_w brake_w')]


ENERGIES = ('joule', 'drivetrain_heat', 'hvch_heat', 'leakage', 'hvch_electric', 'battery_total')


class EnergiesStruct(Structure):
    """`bev_energies`."""

    _fields_ = [(name, c_double) for name in ENERGIES]

    def in_a_row(self) -> list[float]:
        """Return the energies [Wh] in the order of ENERGIES."""
        return (c_double * len(ENERGIES)).from_buffer(self)[:]


class SwitchPlanStruct(Structure):
    """`bev_switch_plan`."""

    _fields_ = [*_each(c_double, 'switching_instant_s least_soc interval_wh'), ('energy_wh', EnergiesStruct),
                *_each(c_int32, 'unheated_keeps_limits keeps_limits costs_least is_heated first_heated end_heated '
                       'is_one_interval reason')]


class BeliefStruct(Structure):
    """`bev_belief`."""

    _fields_ = [*_each(c_int32, 'heaters noises'), *_each(c_void_p, 'weights mean covariance memory')]


class BeliefTermsStruct(Structure):
    """`bev_belief_terms`."""

    _fields_ = [('perturbation', c_double * ELEMENTS), ('lowest', c_double * BOUNDED),
                ('highest', c_double * BOUNDED), *_each(
                    c_double, 'nominal_heat_lag_s nominal_sensor_lag_s local_lag_s shell_share outside_lag_s '
                    'unseen_shell_rise least_variance least_weight most_evidence most_apart_k power_noise '
                    'least_power_w power_noise_lasts_s joule_rise_noise_k_per_kw')]


DRIVE_COLUMNS = (
    'speed_mps', 'ambient_temperature_c', 'propulsion_power_w', 'power_variance_w2',
    'propulsion_power_magnitude_w', 'cabin_heating_power_w', 'auxiliary_power_w', 'terminal_power_w',
    'hidden_variance_w2', 'gamma_0_w_per_k', 'gamma_v_w_per_k_per_mps')


class DriveStruct(Structure):
    """`bev_drive`."""

    _fields_ = [*((name, c_double) for name in DRIVE_COLUMNS), ('is_seen', c_int32)]


class PassedStruct(Structure):
    """`bev_passed`."""

    _fields_ = [*_each(c_void_p, 'transitions wander'),
                *_each(c_double, 'duration_s hidden_variance_s2 seen_w route_w variance_w2 most_w'),
                ('heater_power_w', c_double * MOST_HEATERS), ('source_heat_w', c_double * MOST_HEATERS),
                ('drive', DriveStruct)]


class ReadingStruct(Structure):
    """`bev_reading`."""

    _fields_ = [*_each(c_void_p, 'noise_variances_k2 noise_variances'),
                *_each(c_double, 'lowest_c highest_c lowest_soc highest_soc')]


class ExpectedDriveStruct(Structure):
    """`bev_expected_drive`."""

    _fields_ = [('steps', c_int32), *_each(c_void_p, 'route heater_power_w source_heat_w temperature_c soc'),
                *_each(c_double, 'gamma_0_w_per_k gamma_v_w_per_k_per_mps')]


class NotDescribed(Exception):
    """The core has no such curve."""


class NativeVehicle:
    """A `bev_vehicle`; raises NotDescribed if the core does not have the kind of a curve."""

    def __init__(self, vehicle: Vehicle) -> None:
        """Take the numbers and curves of a Vehicle."""
        battery, path = vehicle.battery, vehicle.heat_path
        self._kept: list[FloatArray] = []
        self.struct = VehicleStruct(
            battery.capacity_ah, battery.heat_capacity_j_per_k, *battery.temperature_range_c, hottest_c(vehicle),
            vehicle.hvch.efficiency, vehicle.drivetrain.heat_share, path.heater_lag_s,
            path.coolant_heat_capacity_j_per_k, path.coolant_conductance_w_per_k, path.shell_share,
            *map(self._curve, (battery.open_circuit_voltage, battery.resistance,
                               battery.charge_power_limit, battery.discharge_power_limit)))
        self.address = addressof(self.struct)

    def _curve(self, curve: Curve) -> CurveStruct:
        factors = []
        while isinstance(curve, ScaledCurve):
            factors.append(float(curve.factor))
            curve = curve.curve
        struct = CurveStruct()
        if len(factors) > MOST_FACTORS:
            raise NotDescribed(f'{len(factors)} factors on a curve')
        # The innermost factor comes first.
        struct.factor_count = len(factors)
        struct.factor[:len(factors)] = factors[::-1]
        if isinstance(curve, PolynomialVoltage):
            polynomial_v = (*curve.polynomial_v, 0.0, 0.0, 0.0)[:4]
            struct.kind = POLYNOMIAL_AND_LOGARITHM if curve.log_soc_v else POLYNOMIAL
            struct.parameter[:] = (*polynomial_v, curve.log_soc_v)
        elif isinstance(curve, InverseTemperatureResistance):
            struct.kind = INVERSE_TEMPERATURE
            struct.parameter[:3] = curve.k_ohm_k, curve.reference_temperature_c, curve.connection_ohm
        elif isinstance(curve, Table):
            struct.kind = TABLE
            self._table(struct, curve)
        else:
            raise NotDescribed(type(curve).__name__)
        return struct

    def _table(self, struct: CurveStruct, table: Table) -> None:
        if max(len(table.soc), len(table.temperature_c)) > MOST_AXIS:
            raise NotDescribed(f'a table with more than {MOST_AXIS} points on an axis')
        struct.soc_count, struct.temperature_count = len(table.soc), len(table.temperature_c)
        for name in ('soc', 'temperature_c', 'values'):
            array = np.array(getattr(table, name), dtype=float).ravel()
            self._kept.append(array)
            setattr(struct, name, address_of(array))


class NativeTrip:
    """A `bev_trip`: points to the block of TripColumns, and keeps it alive."""

    def __init__(self, columns: TripColumns, sources: Sequence[FloatArray] = (), heating: int = 0) -> None:
        """Take the columns of a trip, and of its heat sources the arrays and the number that heat."""
        self.steps, self._block = columns.steps, columns.block
        self._kept = [doubles(array) for array in sources]
        self._sources = HeatSourcesStruct(
            sources[1].shape[2], heating, len(sources[0]), sources[4].shape[1],
            *map(address_of, self._kept)) if sources else None
        first, width = address_of(columns.block), DOUBLE_BYTES * columns.steps
        after = first + width + DOUBLE_BYTES
        self.struct = TripStruct(
            columns.steps, first, *range(after, after + width * (len(TRIP_COLUMNS) - 1), width),
            None if self._sources is None else addressof(self._sources))
        self.address = addressof(self.struct)


def belief_terms(perturbation: FloatArray, lowest: FloatArray, highest: FloatArray,
                 *others: float) -> BeliefTermsStruct:
    """Return a `bev_belief_terms`; `others` are its numbers, in their order."""
    return BeliefTermsStruct((c_double * ELEMENTS)(*perturbation), (c_double * BOUNDED)(*lowest),
                             (c_double * BOUNDED)(*highest), *others)


def address_of(array: NDArray[Any] | None) -> Any:
    """Return the address of the numbers of a contiguous array; None for None."""
    if array is None:
        return None
    try:
        return addressof(c_double.from_buffer(array))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        # Read only, or empty.
        return array.__array_interface__['data'][0]


def doubles(values: Any) -> FloatArray:
    """Return values as a contiguous array of doubles: itself, if it is one."""
    return np.ascontiguousarray(values, dtype=float)
