/* SPDX-License-Identifier: Apache-2.0 */
/* A trip in strides: bev_preheat.planning.strides, and bev_preheat.planning.thresholds._in_steps. */
#include "trip_strides.h"

#include "bev_preheat_core_generated/constants.h"
#include <stdbool.h>

/* Terms that NumPy adds side by side. */
#define LANES 8

enum { DURATION, POWER, VARIANCE, HEAT, LEAKAGE, LIMIT, PROPULSION, SOC, END, TO_BRAKE, TO_HEATER };

/* A step's value times its duration, or (null) its duration. */
static double term_of(const double *values, const double *duration_s, int32_t k) {
  return values == NULL ? duration_s[k] : values[k] * duration_s[k];
}

/* The sum of the terms of steps first ... last - 1, in the order in which NumPy adds them. */
static double sum_of(const double *values, const double *duration_s, int32_t first,
                     int32_t last) {
  int32_t k = first + 1;
  double sum = 0.0;
  if (last - k >= LANES) {
    double lane[LANES];
    for (int32_t n = 0; n < LANES; n++) {
      lane[n] = term_of(values, duration_s, k + n);
    }
    for (k += LANES; k + LANES <= last; k += LANES) {
      for (int32_t n = 0; n < LANES; n++) {
        lane[n] += term_of(values, duration_s, k + n);
      }
    }
    sum = ((lane[0] + lane[1]) + (lane[2] + lane[3]))
        + ((lane[4] + lane[5]) + (lane[6] + lane[7]));
  }
  for (; k < last; k++) {
    sum += term_of(values, duration_s, k);
  }
  return term_of(values, duration_s, first) + sum;
}

/* First steps of the strides: a step in which limits matter is a stride of its own. */
static int32_t find_first_steps(const bev_trip *trip, const bev_watch *watch,
                                double *first_step) {
  int32_t count = 0;
  double length_s = 0.0;
  bool before_limited = true;
  for (int32_t k = 0; k < trip->steps; k++) {
    const bool is_limited = watch->charge[k] != 0u || watch->discharge[k] != 0u;
    const double duration_s = trip->duration_s[k];
    if (k == 0 || is_limited || before_limited || length_s + duration_s > BEV_LONGEST_STRIDE_S) {
      first_step[count] = (double)k;
      count++;
      length_s = 0.0;
    }
    length_s += duration_s;
    before_limited = is_limited;
  }
  first_step[count] = (double)trip->steps;
  return count;
}

/* Warming of a run in steps that do not regenerate [K], ignoring leakage. */
static double paid_k(const bev_vehicle *vehicle, const bev_trip *trip, const double *heater_w) {
  double paid_j = 0.0;
  for (int32_t k = 0; k < trip->steps; k++) {
    paid_j += trip->propulsion_power_w[k] < 0.0 ? 0.0 : heater_w[k] * trip->duration_s[k];
  }
  return vehicle->heater_efficiency * paid_j / vehicle->heat_capacity_j_per_k;
}

/* Approximate lowest and highest temperature of the battery at the start of each stride. */
static void find_reach(const bev_vehicle *vehicle, const bev_trip *trip, const bev_trajectory *trajectory,
                       const bev_look *look, int32_t count, const bev_stride_room *room) {
  const double *run_c = trajectory->states[1];
  const double too_warm_k = bev_minimum(run_c[trip->steps] - look->target_c,
                                        paid_k(vehicle, trip, trajectory->powers_w[0]))
      - BEV_NEAR_TARGET_K;
  const double colder_k = BEV_NEAR_K + bev_maximum(too_warm_k, 0.0);
  double arrived_j = 0.0;
  double more_j = 0.0;
  int32_t m = 0;
  for (int32_t k = 0; k <= trip->steps; k++) {
    if (m <= count && (int32_t)room->first_step[m] == k) {
      room->coldest_c[m] = run_c[k]
          - bev_maximum(arrived_j / vehicle->heat_capacity_j_per_k + BEV_COLDER_MARGIN_K, 0.0);
      room->warmest_c[m] = run_c[k] + more_j / vehicle->heat_capacity_j_per_k + BEV_WARMER_MARGIN_K;
      if (!look->is_first) {
        room->coldest_c[m] = bev_maximum(room->coldest_c[m], run_c[k] - colder_k);
        room->warmest_c[m] = bev_minimum(room->warmest_c[m], run_c[k] + BEV_NEAR_K);
      }
      m++;
    }
    if (k < trip->steps) {
      const double arrived_w = trajectory->rows == 2
          ? vehicle->heater_efficiency * trajectory->powers_w[0][k]
          : trajectory->powers_w[3][k];
      const double more_w =
          bev_maximum(vehicle->heater_efficiency * trip->heater_limit_w[k] - arrived_w, 0.0)
          + vehicle->heat_share * trajectory->powers_w[1][k];
      arrived_j += arrived_w * trip->duration_s[k];
      more_j += more_w * trip->duration_s[k];
    }
  }
}

bev_strides bev_make_strides(const bev_vehicle *vehicle, const bev_trip *trip,
                             const bev_watch *watch, const bev_trajectory *trajectory,
                             const bev_acceptance_loss *loss, const bev_look *look,
                             const bev_stride_room *room) {
  const double *const averaged[PROPULSION - POWER + 1] = {
      trip->idle_power_w,    trip->power_variance_w2, trip->idle_heat_w,
      trip->leakage_w_per_k, trip->heater_limit_w,    trip->propulsion_power_w};
  double *const *column = room->columns;
  const int32_t count = find_first_steps(trip, watch, room->first_step);
  for (int32_t m = 0; m < count; m++) {
    const int32_t first = (int32_t)room->first_step[m];
    const int32_t last = (int32_t)room->first_step[m + 1];
    const double duration_s = sum_of(NULL, trip->duration_s, first, last);
    column[DURATION][m] = duration_s;
    for (int32_t n = POWER; n <= PROPULSION; n++) {
      column[n][m] = sum_of(averaged[n - POWER], trip->duration_s, first, last) / duration_s;
    }
    column[SOC][m] = trajectory->states[0][first];
    column[END][m] = trajectory->states[1][last];
    column[TO_BRAKE][m] = loss->to_brake[first];
    column[TO_HEATER][m] = loss->to_heater[first];
    room->is_limited[m] = watch->charge[first] != 0u || watch->discharge[first] != 0u ? 1u : 0u;
  }
  find_reach(vehicle, trip, trajectory, look, count, room);
  const bev_strides strides = {
      count,           column[DURATION], column[POWER],     column[VARIANCE], column[HEAT],
      column[LEAKAGE], column[LIMIT],    column[PROPULSION], column[SOC],     column[END],
      column[TO_BRAKE], column[TO_HEATER], room->coldest_c, room->warmest_c, room->is_limited};
  return strides;
}

static double between(double here_c, double there_c, double share) {
  /* A band that begins or ends, or is replaced by another band, has no neighbour. */
  double change_c = 0.0;
  if (isfinite(here_c) && isfinite(there_c) && fabs(there_c - here_c) < BEV_NEIGHBOUR_K) {
    change_c = there_c - here_c;
  }
  return here_c + share * change_c;
}

void bev_bands_in_steps(const bev_strides *strides, const bev_stride_room *room, int32_t steps,
                        const double *bands_c, double *floor_c, double *low_c, double *high_c) {
  const int32_t size = strides->strides * BEV_BANDS;
  int32_t m = 0;
  for (int32_t k = 0; k < steps; k++) {
    while (m + 1 < strides->strides && (int32_t)room->first_step[m + 1] <= k) {
      m++;
    }
    const int32_t following = m + 1 < strides->strides ? m + 1 : m;
    const double wide = room->first_step[following] - room->first_step[m];
    const double share = ((double)k - room->first_step[m]) / bev_maximum(wide, 1.0);
    for (int32_t n = 0; n < BEV_BANDS; n++) {
      const int32_t here = m * BEV_BANDS + n;
      const int32_t there = following * BEV_BANDS + n;
      const int32_t at = k * BEV_BANDS + n;
      floor_c[at] = bands_c[here];
      low_c[at] = between(bands_c[size + here], bands_c[size + there], share);
      high_c[at] = between(bands_c[2 * size + here], bands_c[2 * size + there], share);
    }
  }
}
