/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Heating where a watt-hour of battery energy brings the most: the passes of
 * bev_preheat.planning.merit_order, which documents the constants below and the reasons for them.
 */
#include <stdbool.h>

#include "bev_preheat_core_generated/constants.h"
#include "checks.h"
#include "limited_step.h"
#include "strides.h"
#include "trip_strides.h"

/* The constant inputs of the passes, and their working memory. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_vehicle *lumped;
  const bev_trip *trip;
  const bev_settling *goal;
  const double *paid_w;
  bev_acceptance_loss loss;
  bev_watch watch;
  bev_stride_room room;
  double *grid_c;
  double *bands_c;
  double *floor_c;
  double *low_c;
  double *high_c;
  double *curve_memory;
  double *settle_memory;
} passes;

/* How good a run is: whether its charge lasts for the trip, its deficits, and the charge left. */
typedef struct {
  int32_t is_stranded;
  double deficit_w;
  double missed_k;
  double soc;
} merit;

/* Thresholds along a run: bev_preheat.planning.thresholds.find_thresholds. */
static bev_status find_thresholds(const passes *pass, int32_t is_first_look,
                                  const bev_trajectory *trajectory) {
  const bev_trip *trip = pass->trip;
  const double target_c = pass->goal->target_c;
  double least_c = trajectory->states[1][0];
  double most_c = trajectory->states[1][0];
  for (int32_t k = 1; k <= trip->steps; k++) {
    least_c = bev_minimum(least_c, trajectory->states[1][k]);
    most_c = bev_maximum(most_c, trajectory->states[1][k]);
  }
  const double coldest_c =
      bev_maximum(bev_minimum(least_c, target_c) - BEV_MARGIN_K, pass->vehicle->lowest_c);
  const double warmest_c =
      bev_minimum(bev_maximum(most_c, target_c), pass->lumped->highest_c) + BEV_MARGIN_K;
  const double first = floor(bev_maximum(coldest_c - BEV_MARGIN_K, pass->vehicle->lowest_c) / BEV_GRID_K);
  const double end = ceil(warmest_c / BEV_GRID_K) + (double)BEV_COARSE;
  const double wide = end - first;
  const int32_t most = BEV_MOST_GRID;
  if (!(wide > (double)BEV_COARSE) || !(wide <= (double)most)) {
    return BEV_NOT_SETTLED;
  }
  const int32_t points = (int32_t)wide;
  for (int32_t n = 0; n < points; n++) {
    pass->grid_c[n] = BEV_GRID_K * (first + (double)n);
  }
  const bev_look look = {is_first_look, target_c};
  const bev_strides strides = bev_make_strides(pass->lumped, trip, &pass->watch, trajectory,
                                               &pass->loss, &look, &pass->room);
  const bev_curve_range range = {points,    is_first_look, pass->grid_c,
                                 target_c,  coldest_c,     warmest_c,
                                 pass->goal->serves_climbs != 0 ? BEV_PENALTY : 0.0, BEV_PENALTY};
  const bev_status status =
      bev_find_bands(pass->lumped, &strides, &range, pass->curve_memory, pass->bands_c);
  if (status == BEV_OK) {
    bev_bands_in_steps(&strides, &pass->room, trip->steps, pass->bands_c, pass->floor_c,
                       pass->low_c, pass->high_c);
  }
  return status;
}

/* The run under the thresholds along another run. */
static bev_status make_pass(passes *pass, int32_t is_first_look, const bev_trajectory *assumed,
                            bev_trajectory *trajectory) {
  bev_status status = bev_watch_limits(pass->vehicle, pass->trip, assumed, &pass->watch);
  if (status == BEV_OK) {
    status = find_thresholds(pass, is_first_look, assumed);
  }
  if (status != BEV_OK) {
    return status;
  }
  const bev_heating heating = {BEV_BANDS,    1,
                               pass->paid_w, pass->floor_c,
                               pass->low_c,  pass->high_c,
                               pass->watch.charge, pass->watch.discharge};
  for (int32_t n = 0; n < trajectory->rows; n++) {
    trajectory->states[n][0] = assumed->states[n][0];
  }
  return bev_settle(pass->vehicle, pass->trip, &heating, pass->goal, trajectory->states[0],
                    trajectory->powers_w[0], &trajectory->stranding, pass->settle_memory);
}

static bev_status merit_of(const passes *pass, const bev_trajectory *trajectory, merit *found) {
  const int32_t steps = pass->trip->steps;
  found->is_stranded = trajectory->stranding.step >= 0;
  found->missed_k = bev_maximum(0.0, pass->goal->target_c - trajectory->states[1][steps]);
  found->soc = trajectory->states[0][steps];
  found->deficit_w = 0.0;
  return pass->goal->serves_climbs != 0
      ? bev_deficit_w(pass->vehicle, pass->trip, trajectory, &found->deficit_w)
      : BEV_OK;
}

/* Whether a run has a smaller deficit than another, or costs less at the same deficit. */
static int is_better(const merit *one, const merit *other) {
  if (one->is_stranded != other->is_stranded) {
    return !one->is_stranded;
  }
  const double more_w = one->deficit_w - other->deficit_w;
  if (fabs(more_w) > BEV_NO_WORSE_W) {
    return more_w < 0.0;
  }
  if (fabs(one->missed_k - other->missed_k) > BEV_ARRIVAL_TOLERANCE_K) {
    return one->missed_k < other->missed_k;
  }
  return one->soc > other->soc;
}

/* Whether exchanges of heat bring a run to the best: it delivers all, and heat arrives at once. */
static bool is_exchanged(const passes *pass, const merit *found) {
  return bev_is_direct(pass->vehicle) != 0 && found->is_stranded == 0 && found->deficit_w == 0.0;
}

/* Copy a run, and the marks of the steps whose limits were checked. */
static void keep(const passes *pass, const bev_trajectory *from, bev_trajectory *to, uint8_t *watched) {
  const int32_t steps = pass->trip->steps;
  for (int32_t n = 0; n < from->rows; n++) {
    for (int32_t k = 0; k < steps; k++) {
      to->states[n][k] = from->states[n][k];
      to->powers_w[n][k] = from->powers_w[n][k];
    }
    to->states[n][steps] = from->states[n][steps];
  }
  to->stranding = from->stranding;
  for (int32_t k = 0; k < steps; k++) {
    watched[k] = pass->watch.charge[k];
    watched[steps + k] = pass->watch.discharge[k];
  }
}

static double most_apart(const bev_trajectory *one, const bev_trajectory *other, int32_t steps) {
  double most = 0.0;
  for (int32_t k = 0; k <= steps; k++) {
    most = bev_maximum(most, fabs(one->states[0][k] - other->states[0][k]));
  }
  return most;
}

static bev_status make_passes(passes *pass, bev_trajectory runs[2], bev_trajectory *best,
                              uint8_t *watched) {
  merit best_merit = {0, 0.0, 0.0, 0.0};
  int32_t had_loss = 0;
  /* Index of the run along which thresholds are computed; the other run is driven under them. */
  int32_t assumed = 0;
  for (int32_t n = 0; n < BEV_MOST_PASSES; n++) {
    bev_trajectory *trajectory = &runs[1 - assumed];
    merit found;
    bev_status status = make_pass(pass, n == 0, &runs[assumed], trajectory);
    if (status == BEV_OK) {
      status = merit_of(pass, trajectory, &found);
    }
    if (status != BEV_OK) {
      return status;
    }
    if (n == 1 || (n > 1 && is_better(&found, &best_merit))) {
      best_merit = found;
      keep(pass, trajectory, best, watched);
    }
    int32_t has_loss = 0;
    status = bev_blend_acceptance_loss(pass->vehicle, pass->trip, &pass->watch, trajectory,
                                       &pass->loss, &has_loss);
    if (status != BEV_OK) {
      return status;
    }
    const double apart = most_apart(trajectory, &runs[assumed], pass->trip->steps);
    const bool agrees = has_loss == had_loss && apart <= BEV_SOC_AGREEMENT;
    if (n > 0
        && (agrees || (apart <= BEV_SOC_AGREEMENT_FOR_EXCHANGES && is_exchanged(pass, &found)))) {
      break;
    }
    had_loss = has_loss;
    assumed = 1 - assumed;
  }
  return BEV_OK;
}

bev_status bev_merit_order(const bev_vehicle *vehicle, const bev_vehicle *lumped,
                           const bev_trip *trip, const bev_settling *goal, const double *paid_w,
                           double *states, double *powers_w, bev_stranding *stranding,
                           uint8_t *watched, double *memory) {
  const bev_status checked = bev_checked(vehicle, trip, 0);
  if (checked != BEV_OK) {
    return checked;
  }
  if (lumped == NULL || goal == NULL || paid_w == NULL || states == NULL || powers_w == NULL
      || stranding == NULL || watched == NULL || memory == NULL || trip->steps < 1) {
    return BEV_BAD_ARGUMENT;
  }
  if (!bev_is_vehicle(lumped)) {
    return BEV_BAD_VEHICLE;
  }
  const int32_t steps = trip->steps;
  const int32_t rows = bev_is_direct(vehicle) ? 2 : 4;
  if (!bev_are_numbers(states, rows * (steps + 1)) || !bev_are_numbers(powers_w, rows * steps)
      || !isfinite(goal->target_c)) {
    return BEV_BAD_INPUT;
  }
  passes pass;
  pass.vehicle = vehicle;
  pass.lumped = lumped;
  pass.trip = trip;
  pass.goal = goal;
  pass.paid_w = paid_w;
  pass.loss.to_brake = bev_take(&memory, steps);
  pass.loss.to_heater = bev_take(&memory, steps);
  for (int32_t n = 0; n < BEV_STRIDE_COLUMNS; n++) {
    pass.room.columns[n] = bev_take(&memory, steps);
  }
  pass.room.coldest_c = bev_take(&memory, steps + 1);
  pass.room.warmest_c = bev_take(&memory, steps + 1);
  pass.room.first_step = bev_take(&memory, steps + 1);
  pass.grid_c = bev_take(&memory, BEV_MOST_GRID);
  pass.bands_c = bev_take(&memory, 3 * BEV_BANDS * steps);
  pass.floor_c = bev_take(&memory, BEV_BANDS * steps);
  pass.low_c = bev_take(&memory, BEV_BANDS * steps);
  pass.high_c = bev_take(&memory, BEV_BANDS * steps);
  pass.curve_memory = bev_take(&memory, BEV_CURVE_MEMORY);
  pass.settle_memory = bev_take(&memory, BEV_SETTLE_MEMORY(steps));
  double *const other_states = bev_take(&memory, 2 * rows * (steps + 1));
  double *const other_powers_w = bev_take(&memory, 2 * rows * steps);
  pass.watch.charge = &watched[2 * steps];
  pass.watch.discharge = &watched[3 * steps];
  pass.room.is_limited = &watched[4 * steps];
  bev_trajectory best = bev_trajectory_of(rows, steps, states, powers_w);
  bev_trajectory runs[2];
  runs[0] = bev_trajectory_of(rows, steps, other_states, other_powers_w);
  runs[1] = bev_trajectory_of(rows, steps, &other_states[rows * (steps + 1)],
                          &other_powers_w[rows * steps]);
  for (int32_t k = 0; k < steps; k++) {
    pass.loss.to_brake[k] = 0.0;
    pass.loss.to_heater[k] = 0.0;
    pass.watch.charge[k] = 0;
    pass.watch.discharge[k] = 0;
  }
  keep(&pass, &best, &runs[0], watched);
  const bev_status status = make_passes(&pass, runs, &best, watched);
  *stranding = best.stranding;
  return status;
}
