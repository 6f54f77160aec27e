/* SPDX-License-Identifier: Apache-2.0 */
/* How warm surplus regeneration may heat the battery: bev_preheat.planning.free_heat, which documents the reasons. */
#include "surplus_ceiling.h"

#include "bev_preheat_core_generated/constants.h"
#include "checks.h"
#include "heating.h"
#include "limited_step.h"
#include "prices.h"

/* The unheated run, and the remaining share of a kelvin at each instant. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  const double *soc;
  const double *temperature_c;
  const double *kept;
  double offset_k[BEV_PIECES + 1];
} coasting;

/* The run without any heating from a start that is so much warmer [K]. */
static bev_status coast(const bev_vehicle *vehicle, const bev_trip *trip, const double *start,
                        double warmer_k, double *states, double *work, uint8_t *flags) {
  const int32_t rows = bev_is_direct(vehicle) != 0 ? 2 : 4;
  double *const command_w = bev_take(&work, trip->steps);
  bev_stranding stranding = {-1, 1.0};
  for (int32_t n = 0; n < rows; n++) {
    states[n * (trip->steps + 1)] = start[n] + (n == 1 ? warmer_k : 0.0);
  }
  for (int32_t k = 0; k < trip->steps; k++) {
    command_w[k] = 0.0;
  }
  return bev_drive_without_surplus(vehicle, trip, command_w, states, work, flags, &stranding);
}

/* The additional energy that a step takes or gives within the limits of its start, for each offset [J]. */
static bev_status find_more(const coasting *of, int32_t k, double more_j[BEV_PIECES + 1]) {
  const double idle_w = of->trip->idle_power_w[k];
  double least_passed_w = 0.0;
  for (int32_t n = 0; n <= BEV_PIECES; n++) {
    const double temperature_c = bev_minimum(
        of->temperature_c[k] + of->kept[k] * of->offset_k[n], of->vehicle->highest_c);
    double limits_w[2];
    bev_terminal_limits(of->vehicle, BEV_AS_ARRAYS, of->soc[k], temperature_c,
                        of->trip->power_variance_w2[k], limits_w);
    if (!isfinite(limits_w[0]) || !isfinite(limits_w[1])) {
      return BEV_NOT_FINITE;
    }
    const double passed_w =
        idle_w < 0.0 ? -bev_maximum(idle_w, limits_w[0]) : bev_minimum(idle_w, limits_w[1]);
    least_passed_w = n == 0 ? passed_w : least_passed_w;
    more_j[n] = of->trip->duration_s[k] * (passed_w - least_passed_w);
  }
  return BEV_OK;
}

/* By how much warmer than the unheated run the battery may be at an instant, for energy that pays; -inf: not at all. */
static double gaining_k(const coasting *of, const double gained_j[BEV_PIECES + 1], int32_t instant) {
  const bev_vehicle *vehicle = of->vehicle;
  const double least_j_per_k = BEV_LEAST_GAIN / vehicle->heater_efficiency
      * (vehicle->heat_capacity_j_per_k + vehicle->coolant_heat_capacity_j_per_k);
  for (int32_t n = BEV_PIECES - 1; n >= 0; n--) {
    const double width_k = of->offset_k[n + 1] - of->offset_k[n];
    if (gained_j[n + 1] - gained_j[n] >= least_j_per_k * of->kept[instant] * width_k) {
      return of->kept[instant] * of->offset_k[n + 1];
    }
  }
  return -INFINITY;
}

static bev_status find_ceiling(const coasting *of, double target_c, double *ceiling_c) {
  const int32_t steps = of->trip->steps;
  const double arrival_c = of->temperature_c[steps];
  const double highest_c = of->vehicle->highest_c;
  const double most_c =
      bev_maximum(highest_c - BEV_BELOW_HIGHEST_K, bev_minimum(target_c, highest_c));
  double gained_j[BEV_PIECES + 1] = {0.0};
  bool is_full = false;
  for (int32_t k = steps - 1; k >= 0; k--) {
    double more_j[BEV_PIECES + 1];
    const double here_c = of->temperature_c[k + 1];
    const double coasting_c =
        here_c + (target_c - arrival_c) * of->kept[k + 1] / of->kept[steps];
    const double gaining_c = here_c + gaining_k(of, gained_j, k + 1);
    ceiling_c[k] = bev_minimum(bev_maximum(coasting_c, gaining_c), most_c);
    const bev_status status = find_more(of, k, more_j);
    if (status != BEV_OK) {
      return status;
    }
    /* A battery that takes more before it is full takes less then. */
    is_full = is_full || of->soc[k + 1] >= BEV_FULL_SOC;
    for (int32_t n = 0; n <= BEV_PIECES && (of->trip->idle_power_w[k] >= 0.0 || !is_full); n++) {
      gained_j[n] += more_j[n];
    }
  }
  return BEV_OK;
}

bev_status bev_find_surplus_ceiling(const bev_vehicle *vehicle, const bev_trip *trip,
                                    const double *start, double target_c, const double *soc,
                                    double *memory, uint8_t *flags, double *ceiling_c) {
  const bev_status checked = bev_checked(vehicle, trip, 0);
  if (checked != BEV_OK) {
    return checked;
  }
  if (start == NULL || soc == NULL || memory == NULL || flags == NULL || ceiling_c == NULL || trip->steps < 1) {
    return BEV_BAD_ARGUMENT;
  }
  if (!isfinite(target_c) || !bev_are_numbers(soc, trip->steps + 1)) {
    return BEV_BAD_INPUT;
  }
  const int32_t instants = trip->steps + 1;
  const int32_t rows = bev_is_direct(vehicle) != 0 ? 2 : 4;
  double *const cool = bev_take(&memory, rows * instants);
  double *const warm = bev_take(&memory, rows * instants);
  bev_status status = coast(vehicle, trip, start, 0.0, cool, memory, flags);
  if (status == BEV_OK) {
    status = coast(vehicle, trip, start, BEV_WARMER_K, warm, memory, flags);
  }
  if (status != BEV_OK) {
    return status;
  }
  /* This is the only use of the warmer run. */
  double *const kept = warm;
  for (int32_t k = 0; k < instants; k++) {
    kept[k] = bev_maximum((warm[instants + k] - cool[instants + k]) / BEV_WARMER_K, BEV_LEAST_KEPT);
  }
  coasting of = {vehicle, trip, soc, &cool[instants], kept, {0.0}};
  double width_k = 1.0;
  for (int32_t n = 0; n < BEV_PIECES; n++) {
    of.offset_k[n + 1] = of.offset_k[n] + width_k;
    width_k *= BEV_WIDER;
  }
  return find_ceiling(&of, target_c, ceiling_c);
}

bool bev_is_too_warm(const bev_trip *trip, double target_c, const bev_trajectory *trajectory) {
  bool is_free = false;
  for (int32_t k = 0; k < trip->steps; k++) {
    is_free = is_free || (trajectory->powers_w[0][k] > 0.0 && trip->propulsion_power_w[k] < 0.0);
  }
  return is_free && trajectory->states[1][trip->steps] > target_c + BEV_ABOVE_TARGET_K;
}

bev_status bev_is_as_useful(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                            const bev_trajectory *bounded, const bev_trajectory *free_run, bool *is_so) {
  const int32_t steps = trip->steps;
  const int32_t drawn = bounded->rows == 2 ? 0 : 2;
  const double missed_k = target_c - bounded->states[1][steps];
  const double free_missed_k = target_c - free_run->states[1][steps];
  double deficit_w = 0.0;
  double free_deficit_w = 0.0;
  double saved_j = 0.0;
  *is_so = false;
  if ((bounded->stranding.step < 0) != (free_run->stranding.step < 0)
      || missed_k > bev_maximum(free_missed_k, 0.0) + BEV_MISSED_K) {
    return BEV_OK;
  }
  bev_status status = bev_deficit_w(vehicle, trip, bounded, &deficit_w);
  if (status == BEV_OK) {
    status = bev_deficit_w(vehicle, trip, free_run, &free_deficit_w);
  }
  for (int32_t k = 0; k < steps; k++) {
    saved_j += (free_run->powers_w[drawn][k] - bounded->powers_w[drawn][k]) * trip->duration_s[k];
  }
  const double lost_wh = (free_run->states[0][steps] - bounded->states[0][steps])
      * bev_whole_charge_wh(vehicle, free_run->states[0][steps], free_run->states[1][steps]);
  *is_so = deficit_w <= free_deficit_w
      && lost_wh <= BEV_LEAST_GAIN * bev_maximum(saved_j / BEV_JOULES_PER_WH, 0.0);
  return status;
}
