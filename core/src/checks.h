/* SPDX-License-Identifier: Apache-2.0 */
/* Checks of a call's arguments before use. */
#ifndef BEV_PREHEAT_CORE_CHECKS_H_
#define BEV_PREHEAT_CORE_CHECKS_H_

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#include "bev_preheat_core/core.h"

static inline int bev_are_numbers(const double *values, int32_t count) {
  /* No early exit: without a branch the compiler checks several values at once. */
  int are_numbers = 1;
  for (int32_t n = 0; n < count; n++) {
    are_numbers = isfinite(values[n]) != 0 ? are_numbers : 0;
  }
  return are_numbers;
}

/* Whether a curve can be read: its kind, its counts, its pointers. */
static inline int bev_is_curve(const bev_curve *curve) {
  if (curve->kind < (int32_t)BEV_POLYNOMIAL || curve->kind > (int32_t)BEV_TABLE
      || curve->factor_count < 0
      || curve->factor_count > BEV_MOST_FACTORS) {
    return 0;
  }
  if (curve->kind != (int32_t)BEV_TABLE) {
    return 1;
  }
  return curve->soc != NULL && curve->temperature_c != NULL && curve->values != NULL
      && curve->soc_count >= 1 && curve->soc_count <= BEV_MOST_AXIS
      && curve->temperature_count >= 1 && curve->temperature_count <= BEV_MOST_AXIS;
}

static inline int bev_is_vehicle(const bev_vehicle *vehicle) {
  return isfinite(vehicle->capacity_ah) && vehicle->capacity_ah > 0.0
      && isfinite(vehicle->heat_capacity_j_per_k) && vehicle->heat_capacity_j_per_k > 0.0
      && isfinite(vehicle->lowest_c) && isfinite(vehicle->highest_c)
      && isfinite(vehicle->hottest_c)
      && isfinite(vehicle->heater_efficiency) && vehicle->heater_efficiency > 0.0
      && isfinite(vehicle->heat_share)
      && isfinite(vehicle->heater_lag_s) && vehicle->heater_lag_s >= 0.0
      && isfinite(vehicle->coolant_heat_capacity_j_per_k)
      && vehicle->coolant_heat_capacity_j_per_k >= 0.0
      && isfinite(vehicle->coolant_conductance_w_per_k)
      && (vehicle->coolant_heat_capacity_j_per_k == 0.0
          || vehicle->coolant_conductance_w_per_k > 0.0)
      && vehicle->shell_share >= 0.0 && vehicle->shell_share < 1.0
      && bev_is_curve(&vehicle->open_circuit_voltage) && bev_is_curve(&vehicle->resistance)
      && bev_is_curve(&vehicle->charge_power_limit)
      && bev_is_curve(&vehicle->discharge_power_limit);
}

static inline int bev_are_sources(const bev_heat_sources *sources) {
  return sources->count >= 1 && sources->count <= BEV_MOST_SOURCES
      && sources->heating_count >= 1 && sources->heating_count <= sources->count
      && sources->temperature_count >= 2 && sources->temperature_count <= BEV_MOST_AXIS
      && sources->temperature_c != NULL && sources->power_w != NULL && sources->hvch_watts != NULL
      && sources->step_count >= 1 && sources->step_count <= BEV_MOST_AXIS && sources->steps_w != NULL
      && sources->taken_w != NULL && sources->drawing_limit_w != NULL && sources->cold_limit_w != NULL;
}

static inline int bev_is_trip(const bev_trip *trip) {
  return trip->steps >= 0 && trip->steps <= BEV_MOST_STEPS && trip->time_s != NULL
      && trip->duration_s != NULL && trip->idle_power_w != NULL
      && trip->power_variance_w2 != NULL && trip->idle_heat_w != NULL
      && trip->leakage_w_per_k != NULL && trip->heater_limit_w != NULL
      && trip->propulsion_power_w != NULL && trip->drivetrain_heat_w != NULL
      && trip->ambient_temperature_c != NULL
      && (trip->sources == NULL || bev_are_sources(trip->sources));
}

/* BEV_OK if vehicle and trip can be used, and `first` is a step of the trip or its end. */
static inline bev_status bev_checked(const bev_vehicle *vehicle, const bev_trip *trip, int32_t first) {
  if (vehicle == NULL || trip == NULL || !bev_is_trip(trip) || first < 0
      || first > trip->steps) {
    return BEV_BAD_ARGUMENT;
  }
  return bev_is_vehicle(vehicle) ? BEV_OK : BEV_BAD_VEHICLE;
}

/* Whether the instants of a trip are numbers that rise. */
static inline int bev_is_time(const bev_trip *trip) {
  for (int32_t k = 0; k < trip->steps; k++) {
    if (!isfinite(trip->time_s[k]) || !(trip->time_s[k + 1] > trip->time_s[k])) {
      return 0;
    }
  }
  return isfinite(trip->time_s[trip->steps]);
}

#endif /* BEV_PREHEAT_CORE_CHECKS_H_ */
