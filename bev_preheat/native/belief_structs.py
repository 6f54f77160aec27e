# SPDX-License-Identifier: Apache-2.0
"""Structs of core.h that the estimation's filters are given in."""

from __future__ import annotations

from ctypes import c_double, c_int32, c_void_p, Structure
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

ELEMENTS, BOUNDED, MOST_HEATERS = 14, 9, 16


class BeliefStruct(Structure):
    """`bev_belief`."""

    _fields_ = [('heaters', c_int32), ('noises', c_int32), *((name, c_void_p) for name in (
        'weights', 'mean', 'covariance', 'memory'))]


class BeliefTermsStruct(Structure):
    """`bev_belief_terms`."""

    _fields_ = [('perturbation', c_double * ELEMENTS), ('lowest', c_double * BOUNDED),
                ('highest', c_double * BOUNDED), *((name, c_double) for name in (
                    'nominal_heat_lag_s', 'nominal_sensor_lag_s', 'local_lag_s', 'least_variance', 'least_weight',
                    'most_evidence', 'most_apart_k', 'most_under_way_k', 'power_noise', 'least_power_w',
                    'power_noise_lasts_s', 'joule_rise_noise_k_per_kw'))]


DRIVE_COLUMNS = (
    'speed_mps', 'ambient_temperature_c', 'propulsion_power_w', 'power_variance_w2',
    'propulsion_power_magnitude_w', 'cabin_heating_power_w', 'auxiliary_power_w', 'terminal_power_w',
    'hidden_variance_w2', 'gamma_0_w_per_k', 'gamma_v_w_per_k_per_mps')


class DriveStruct(Structure):
    """`bev_drive`."""

    _fields_ = [*((name, c_double) for name in DRIVE_COLUMNS), ('is_seen', c_int32)]


class PassedStruct(Structure):
    """`bev_passed`."""

    _fields_ = [('transitions', c_void_p), ('wander', c_void_p), *((name, c_double) for name in (
        'duration_s', 'hidden_variance_s2', 'seen_w', 'route_w', 'variance_w2', 'most_w')),
        ('heater_power_w', c_double * MOST_HEATERS), ('drive', DriveStruct)]


class ReadingStruct(Structure):
    """`bev_reading`."""

    _fields_ = [('noise_variances_k2', c_void_p), ('noise_variances', c_void_p), *((name, c_double) for name in (
        'lowest_c', 'highest_c', 'lowest_soc', 'highest_soc')), ('tells_hypotheses', c_int32)]


class ExpectedDriveStruct(Structure):
    """`bev_expected_drive`."""

    _fields_ = [('steps', c_int32), *((name, c_void_p) for name in (
        'route', 'heater_power_w', 'temperature_c', 'soc')),
                ('gamma_0_w_per_k', c_double), ('gamma_v_w_per_k_per_mps', c_double)]


def belief_terms(perturbation: FloatArray, lowest: FloatArray, highest: FloatArray,
                 *others: float) -> BeliefTermsStruct:
    """Return a `bev_belief_terms`; `others` are its numbers, in their order."""
    return BeliefTermsStruct((c_double * ELEMENTS)(*perturbation), (c_double * BOUNDED)(*lowest),
                             (c_double * BOUNDED)(*highest), *others)
