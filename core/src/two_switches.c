/* SPDX-License-Identifier: Apache-2.0 */
/*
 * When to switch the heater on and off if its heat arrives late: bev_preheat.planning.two_switches with the
 * searches of bev_preheat.planning.bracketing.
 */
#include "bev_preheat_core_generated/constants.h"
#include "bracketing.h"
#include "checks.h"
#include "limited_run.h"
#include "parts_of_plans.h"
#include "steps_of_model.h"

/* Maximum number of switch-off instants tried: enough to reduce a bracket of any length to the resolution. */
#define MOST_PAIRS 64

/* The constant inputs of the search for instants, the memory of each run, and the result. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  const double *idle_states;
  double target_c;
  double arrival_s;
  double capacity_j_per_k;
  double mean_limit_w;
  double *states;
  double *command_w;
  /* Energy from the cells in the unheated run until the start of each step [Wh]. */
  double *idle_taken_wh;
  double off_s;
  /* Energy from the cells in the last run [Wh]. */
  double taken_wh;
  int32_t pairs;
  double off_of[MOST_PAIRS];
  double on_of[MOST_PAIRS];
} two_switch_search;

/* An instant of switching off [s], the energy taken [Wh], and the instant of switching on [s]. */
typedef struct {
  double off_s;
  double taken_wh;
  double on_s;
} pair;

/* The run heated from an instant on until `off_s`; its excess over the target on arrival. */
static bev_status heat_from(void *searched, double on_s, double *above_k) {
  two_switch_search *of = (two_switch_search *)searched;
  const bev_trip *trip = of->trip;
  const int32_t instants = trip->steps + 1;
  const int32_t first = bev_step_at(trip, on_s);
  for (int32_t k = 0; k < trip->steps; k++) {
    const double heated_s =
        bev_minimum(trip->time_s[k + 1], of->off_s) - bev_maximum(trip->time_s[k], on_s);
    of->command_w[k] = bev_minimum(bev_maximum(heated_s / trip->duration_s[k], 0.0), 1.0)
        * trip->heater_limit_w[k];
  }
  for (int32_t n = 0; n < 4; n++) {
    for (int32_t k = 0; k <= first; k++) {
      of->states[n * instants + k] = of->idle_states[n * instants + k];
    }
  }
  of->taken_wh = of->idle_taken_wh[first];
  const bev_status status = bev_run_heated_with_energy(of->vehicle, trip, first, of->command_w,
                                                       of->states, &of->taken_wh);
  of->taken_wh += of->vehicle->heater_lag_s * of->states[3 * instants - 1] / BEV_JOULES_PER_WH;
  *above_k = of->states[2 * instants - 1] - of->target_c;
  return status;
}

/* Change of the arrival temperature with the instant of switching on [K/s], an estimate. */
static double slope_k_per_s(const two_switch_search *of, double on_s) {
  const int32_t step = bev_step_at(of->trip, on_s);
  const double leaks_per_s = of->trip->leakage_w_per_k[step] / of->capacity_j_per_k;
  return -of->vehicle->heater_efficiency * of->trip->heater_limit_w[step] / of->capacity_j_per_k
      * exp(-leaks_per_s * (of->arrival_s - on_s));
}

/* The pairs found next to an instant: the n-th nearest; among equals, the earliest found. */
static int32_t nearest(const two_switch_search *of, double off_s, int32_t other_than) {
  int32_t found = -1;
  for (int32_t n = 0; n < of->pairs; n++) {
    if (n != other_than
        && (found < 0 || fabs(of->off_of[n] - off_s) < fabs(of->off_of[found] - off_s))) {
      found = n;
    }
  }
  return found;
}

/* Estimate of when to switch on [s]: along a line through the nearest pairs. */
static double guess_s(const two_switch_search *of, double off_s) {
  if (of->pairs < 2) {
    const double deficit_k = of->target_c - of->idle_states[2 * of->trip->steps + 1];
    return off_s
        - deficit_k * of->capacity_j_per_k
        / bev_maximum(of->vehicle->heater_efficiency * of->mean_limit_w, 1.0);
  }
  const int32_t a = nearest(of, off_s, -1);
  const int32_t b = nearest(of, off_s, a);
  return of->on_of[a]
      + (of->on_of[b] - of->on_of[a]) * (off_s - of->off_of[a]) / (of->off_of[b] - of->off_of[a]);
}

/* The instant of switching on with which the battery arrives at the target. */
static bev_status find_on(two_switch_search *of, double off_s, double guessed_s, double tolerance_k, double *on_s,
                          double *above_k) {
  if (!isfinite(guessed_s)) {
    return BEV_NOT_FINITE;
  }
  of->off_s = off_s;
  *on_s = bev_minimum(bev_maximum(guessed_s, 0.0), off_s);
  const bev_status status = heat_from(of, *on_s, above_k);
  if (status < BEV_OK) {
    return status;
  }
  const bev_ending ending = {tolerance_k, 0.0, BEV_MOST_TRIALS};
  return bev_follow_slope(0.0, off_s, slope_k_per_s(of, *on_s), &ending, heat_from, of, on_s,
                          above_k);
}

/* By how much full heating until an instant warms battery and coolant [K], ignoring leakage. */
static double before_k(const two_switch_search *of, double on_s) {
  const bev_trip *trip = of->trip;
  double heater_j = 0.0;
  for (int32_t k = 0; k < trip->steps; k++) {
    const double heated_s = bev_minimum(trip->time_s[k + 1], on_s) - trip->time_s[k];
    heater_j += trip->heater_limit_w[k] * bev_maximum(heated_s, 0.0);
  }
  return of->vehicle->heater_efficiency * heater_j / of->capacity_j_per_k;
}

/* Energy taken to arrive at the target when switched off at an instant. */
static bev_status heat_until(two_switch_search *of, double off_s, pair *made) {
  if (of->pairs >= MOST_PAIRS) {
    return BEV_NOT_SETTLED;
  }
  double above_k = 0.0;
  made->off_s = off_s;
  const bev_status status = find_on(of, off_s, guess_s(of, off_s), BEV_COMPARED_TOLERANCE_K,
                                    &made->on_s, &above_k);
  if (status < BEV_OK) {
    return status;
  }
  of->off_of[of->pairs] = off_s;
  of->on_of[of->pairs] = made->on_s;
  of->pairs++;
  made->taken_wh = of->taken_wh;
  /*
   * The deficit is made up for by heat from the first instant on; part of that heat leaks, or stays in the coolant.
   */
  const double allowed_k = bev_minimum(
      BEV_COMPARED_TOLERANCE_K, BEV_ARRIVAL_TOLERANCE_K + (BEV_SURE_SHARE * before_k(of, made->on_s)));
  const double slope = slope_k_per_s(of, made->on_s);
  if (above_k < -allowed_k) {
    made->taken_wh -= BEV_DEFICIT_WH_PER_K * above_k;
  } else if (slope < 0.0) {
    const double heater_w = of->trip->heater_limit_w[bev_step_at(of->trip, made->on_s)];
    made->taken_wh += above_k * heater_w / BEV_JOULES_PER_WH / slope;
  } else {
    /* If the heater takes no power there, the excess costs nothing. */
  }
  return isfinite(made->taken_wh) ? BEV_OK : BEV_NOT_FINITE;
}

static void keep_better(pair *best, const pair *other) {
  if (other->taken_wh < best->taken_wh) {
    *best = *other;
  }
}

/* Golden section search: the pair that takes the least energy, switched off between two instants. */
static bev_status find_least(two_switch_search *of, double earliest_s, double latest_s, pair *best) {
  const double golden = 0.5 * (sqrt(5.0) - 1.0);
  double low_s = earliest_s;
  double high_s = latest_s;
  pair nearer;
  pair further;
  bev_status status = heat_until(of, low_s + (1.0 - golden) * (high_s - low_s), &nearer);
  if (status == BEV_OK) {
    status = heat_until(of, low_s + golden * (high_s - low_s), &further);
  }
  if (status != BEV_OK) {
    return status;
  }
  *best = nearer;
  keep_better(best, &further);
  /* Bounded by MOST_PAIRS, after which heat_until fails. */
  while (high_s - low_s > BEV_OFF_RESOLUTION_S) {
    pair *following;
    if (nearer.taken_wh <= further.taken_wh) {
      high_s = further.off_s;
      further = nearer;
      following = &nearer;
      status = heat_until(of, low_s + (1.0 - golden) * (high_s - low_s), following);
    } else {
      low_s = nearer.off_s;
      nearer = further;
      following = &further;
      status = heat_until(of, low_s + golden * (high_s - low_s), following);
    }
    if (status != BEV_OK) {
      return status;
    }
    keep_better(best, following);
  }
  /* The minimum may lie at an end, which the search only approaches. */
  const double ends_s[2] = {low_s, high_s};
  for (int32_t n = 0; n < 2; n++) {
    pair end;
    status = heat_until(of, ends_s[n], &end);
    if (status != BEV_OK) {
      return status;
    }
    keep_better(best, &end);
  }
  return BEV_OK;
}

/* The search for both instants; if no pair is enough, heat throughout. */
static bev_status find_switches(two_switch_search *of, double *on_s, double *off_s) {
  double above_k = 0.0;
  *on_s = 0.0;
  *off_s = of->arrival_s;
  of->off_s = of->arrival_s;
  bev_status status = heat_from(of, 0.0, &above_k);
  if (status < BEV_OK) {
    return status;
  }
  if (!isfinite(above_k)) {
    return BEV_NOT_FINITE;
  }
  if (of->states[2 * of->trip->steps + 1] <= of->target_c) {
    return BEV_OK;
  }
  const double earliest_s =
      bev_maximum(0.0, of->arrival_s - BEV_MOST_LAGS * bev_heat_lag_s(of->vehicle));
  pair best;
  status = find_least(of, earliest_s, of->arrival_s, &best);
  if (status != BEV_OK) {
    return status;
  }
  *off_s = best.off_s;
  return find_on(of, best.off_s, best.on_s, BEV_ARRIVAL_TOLERANCE_K, on_s, &above_k);
}

/* Energy from the cells in the unheated run until the start of each step [Wh]. */
static bev_status add_up_idle(const two_switch_search *of) {
  const bev_trip *trip = of->trip;
  const int32_t instants = trip->steps + 1;
  of->idle_taken_wh[0] = 0.0;
  for (int32_t k = 0; k < trip->steps; k++) {
    const bev_inputs inputs = bev_inputs_of(of->vehicle, trip, k, NULL, NULL);
    const double states[4] = {of->idle_states[k], of->idle_states[instants + k],
                              of->idle_states[2 * instants + k],
                              of->idle_states[3 * instants + k]};
    double result[8];
    if (!bev_are_finite(&inputs) || !isfinite(trip->heater_limit_w[k])) {
      return BEV_BAD_INPUT;
    }
    bev_integrate_heated(of->vehicle, BEV_AS_ARRAYS, states, &inputs, 0.0, result);
    const double battery_w = inputs.power_w + result[6] + result[5];
    of->idle_taken_wh[k + 1] =
        of->idle_taken_wh[k] + inputs.duration_s / BEV_JOULES_PER_WH * battery_w;
  }
  return isfinite(of->idle_taken_wh[trip->steps]) ? BEV_OK : BEV_NOT_FINITE;
}

bev_status bev_find_two_switches(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                                 const double *idle_states, double *memory, double *states, double *command_w,
                                 double *heat_w, double *on_s, double *off_s) {
  bev_status status = bev_checked(vehicle, trip, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (trip->steps < 1 || idle_states == NULL || memory == NULL || states == NULL
      || command_w == NULL || on_s == NULL || off_s == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  if (!isfinite(target_c) || !bev_is_time(trip)) {
    return BEV_BAD_INPUT;
  }
  const double arrival_s = trip->time_s[trip->steps];
  double limit_j = 0.0;
  for (int32_t k = 0; k < trip->steps; k++) {
    limit_j += trip->heater_limit_w[k] * trip->duration_s[k];
  }
  two_switch_search of = {vehicle, trip, idle_states, target_c, arrival_s,
                          vehicle->heat_capacity_j_per_k + vehicle->coolant_heat_capacity_j_per_k,
                          limit_j / arrival_s, states, command_w, memory, 0.0, 0.0, 0, {0.0}, {0.0}};
  status = add_up_idle(&of);
  if (status == BEV_OK) {
    status = find_switches(&of, on_s, off_s);
  }
  if (status < BEV_OK || heat_w == NULL) {
    return status;
  }
  const bev_status along = bev_heat_along(vehicle, trip, states, command_w, heat_w);
  return along == BEV_OK ? status : along;
}
