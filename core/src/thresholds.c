/* SPDX-License-Identifier: Apache-2.0 */
/* Below which temperatures heating pays in each stride: the loop of bev_preheat.planning.thresholds. */
#include "bev_preheat_core_generated/constants.h"
#include "arithmetic.h"
#include "checks.h"
#include "sorted.h"
#include "value_curve.h"

/* Value of a joule in the battery before stride m, from its value after the stride [J/J]. */
static double joule_worth_before(const bev_strides *strides, int32_t m, const bev_points *after,
                                 double k_per_joule, double joule_worth) {
  double worth = joule_worth - joule_worth * strides->loss_to_brake[m];
  if (strides->loss_to_heater[m] > 0.0) {
    const double heat_worth = k_per_joule * bev_worth_j_per_k(after, strides->end_c[m]);
    worth = worth - strides->loss_to_heater[m] * bev_maximum(worth - heat_worth, 0.0);
  }
  return worth;
}

static double held(double value, double low, double high) {
  return bev_minimum(bev_maximum(value, low), high);
}

static int are_strides(const bev_strides *strides) {
  return strides->strides >= 0 && strides->strides <= BEV_MOST_STEPS
      && strides->duration_s != NULL && strides->idle_power_w != NULL
      && strides->power_variance_w2 != NULL && strides->idle_heat_w != NULL
      && strides->leakage_w_per_k != NULL && strides->heater_limit_w != NULL
      && strides->propulsion_w != NULL && strides->soc != NULL && strides->end_c != NULL
      && strides->loss_to_brake != NULL && strides->loss_to_heater != NULL
      && strides->coldest_c != NULL && strides->warmest_c != NULL && strides->is_limited != NULL;
}

bev_status bev_find_bands(const bev_vehicle *vehicle, const bev_strides *strides,
                          const bev_curve_range *range, double *memory, double *bands_c) {
  if (vehicle == NULL || strides == NULL || range == NULL || memory == NULL || bands_c == NULL
      || !are_strides(strides) || range->grid_points <= BEV_COARSE
      || range->grid_points > BEV_MOST_GRID || range->grid_c == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  if (!bev_is_vehicle(vehicle)) {
    return BEV_BAD_VEHICLE;
  }
  const int32_t count = range->grid_points;
  const double *grid_c = range->grid_c;
  if (!isfinite(range->coldest_c) || !isfinite(range->warmest_c) || !isfinite(range->target_c)
      || !isfinite(range->penalty) || !bev_are_numbers(grid_c, count)
      || !bev_is_sorted(grid_c, count)) {
    return BEV_BAD_INPUT;
  }
  const double k_per_joule = vehicle->heater_efficiency / vehicle->heat_capacity_j_per_k;
  const double short_j_per_k = range->short_penalty / k_per_joule;
  bev_curves curves = bev_curves_in(memory);
  int is_target_there = 0;
  for (int32_t n = 0; n <= count; n++) {
    if (!is_target_there && (n == count || grid_c[n] >= range->target_c)) {
      is_target_there = 1;
      bev_append(&curves.next, range->target_c, 0.0);
      if (n < count && grid_c[n] == range->target_c) {
        continue;
      }
    }
    if (n < count) {
      bev_append(&curves.next, grid_c[n],
                 short_j_per_k * bev_maximum(range->target_c - grid_c[n], 0.0));
    }
  }
  const double lowest_c = range->coldest_c;
  const double highest_c = range->warmest_c;
  double joule_worth = 1.0;
  for (int32_t m = strides->strides; m >= 0; m--) {
    if (!isfinite(strides->coldest_c[m]) || !isfinite(strides->warmest_c[m])) {
      return BEV_BAD_INPUT;
    }
    /* The part of the curve that is needed where stride m begins, or on arrival. */
    bev_status status = bev_part_of_curve(
        &curves.next, held(strides->coldest_c[m], lowest_c, highest_c - 1.0),
        held(strides->warmest_c[m], lowest_c + 1.0, highest_c), &curves.after);
    if (status == BEV_OK && m > 0) {
      const int32_t at = (m - 1) * BEV_BANDS;
      const int32_t size = strides->strides * BEV_BANDS;
      const bev_bands bands = {&bands_c[at], &bands_c[size + at], &bands_c[2 * size + at]};
      for (int32_t n = 0; n < BEV_BANDS; n++) {
        bands.floor_c[n] = INFINITY;
        bands.low_c[n] = -INFINITY;
        bands.high_c[n] = -INFINITY;
      }
      status = bev_map_stride(vehicle, strides, m - 1, range, &curves.map);
      if (status == BEV_OK) {
        status = bev_curve_before(&curves, joule_worth, &bands);
      }
      joule_worth =
          joule_worth_before(strides, m - 1, &curves.after, k_per_joule, joule_worth);
    }
    if (status != BEV_OK) {
      return status;
    }
  }
  return BEV_OK;
}
