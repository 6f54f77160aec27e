/* SPDX-License-Identifier: Apache-2.0 */
/* The run that delivers its climbs and arrives at the target: bev_preheat.planning.threshold_search. */
#include "threshold_search.h"

#include "bev_preheat_core_generated/constants.h"
#include <stdbool.h>

#include "heating.h"
#include "step_limits.h"

static const bev_requirement TARGET = {-1, -1};

bev_status bev_find_climbs(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                           const double *temperature_c,
                           bev_requirement climbs[BEV_MOST_CLIMBS], int32_t *count) {
  const int32_t steps = trip->steps;
  double least_w[BEV_LIMITS_BLOCK];
  double most_w[BEV_LIMITS_BLOCK];
  bool was_demanding = false;
  *count = 0;
  for (int32_t from = 0; from < steps; from += BEV_LIMITS_BLOCK) {
    const int32_t seen = steps - from < BEV_LIMITS_BLOCK ? steps - from : BEV_LIMITS_BLOCK;
    const bev_status status = bev_limits_of_block(
        vehicle, seen, &soc[from], &temperature_c[from], BEV_COLDER_BY_K,
        &trip->power_variance_w2[from], least_w, most_w);
    if (status != BEV_OK) {
      return status;
    }
    for (int32_t k = from; k < from + seen; k++) {
      const bool is_demanding = trip->idle_power_w[k] > most_w[k - from];
      if (is_demanding && !was_demanding) {
        if (*count == BEV_MOST_CLIMBS) {
          return BEV_OK;
        }
        climbs[*count].first = k;
        (*count)++;
      }
      if (is_demanding) {
        climbs[*count - 1].last = k + 1;
      }
      was_demanding = is_demanding;
    }
  }
  return BEV_OK;
}

static void copy(double *to, const double *from, int32_t count) {
  for (int32_t n = 0; n < count; n++) {
    to[n] = from[n];
  }
}

/* Copy a run and the shifts that belong to it. */
static void copy_run(const bev_threshold_search *search, bev_search_run *to,
                     const bev_search_run *from, double *to_k, const double *from_k) {
  const int32_t steps = search->limits.trip->steps;
  for (int32_t n = 0; n < search->rows; n++) {
    copy(to->states[n], from->states[n], steps + 1);
    copy(to->powers_w[n], from->powers_w[n], steps);
  }
  copy(to->wanted_w, from->wanted_w, steps);
  copy(to_k, from_k, steps);
  to->until = from->until;
  to->stranding = from->stranding;
}

/* Keep the run without paid heating in steps first ... last - 1 if its excess is greater. */
static bev_status take_unheated_if_better(bev_threshold_search *search, int32_t first, int32_t last,
                                          const bev_requirement *required, double excess) {
  copy(search->saved_shift_k, search->shift_k, search->limits.trip->steps);
  for (int32_t k = first; k < last; k++) {
    search->shift_k[k] = 0.0;
  }
  bev_search_trial unheated = {BEV_UNHEATED_SHIFT_K, 0.0, 0};
  bev_status status = bev_search_drive(search, first, last, BEV_UNHEATED_SHIFT_K, required->last,
                                       BEV_KEPT_RUN, unheated.run);
  if (status == BEV_OK) {
    status = bev_search_excess(search, &search->runs[unheated.run], required, &unheated.excess);
  }
  if (status != BEV_OK) {
    return status;
  }
  if (unheated.excess < excess) {
    copy(search->shift_k, search->saved_shift_k, search->limits.trip->steps);
    return BEV_OK;
  }
  return bev_search_keep(search, first, last, &unheated);
}

/* Move the kept run from step `first` on so that it meets the target, and no more. */
static bev_status meet_target(bev_threshold_search *search, int32_t first) {
  const int32_t steps = search->limits.trip->steps;
  double excess_k = 0.0;
  bev_status status =
      bev_search_excess(search, &search->runs[BEV_KEPT_RUN], &TARGET, &excess_k);
  if (status == BEV_OK && excess_k > BEV_ARRIVAL_TOLERANCE_K) {
    /* If heating that pays for itself and free heating lead beyond the target, no shift brings the run down. */
    status = bev_search_drive(search, first, steps, -BEV_ARRIVAL_OVERSHOOT_K, steps, BEV_KEPT_RUN, 0);
    if (status == BEV_OK) {
      status = bev_search_excess(search, &search->runs[0], &TARGET, &excess_k);
    }
    if (status == BEV_OK && excess_k > 0.0) {
      return BEV_OK;
    }
  }
  return status == BEV_OK
      ? bev_search_move(search, first, steps, &TARGET, BEV_ARRIVAL_TOLERANCE_K)
      : status;
}

/* The same, unless less can then be delivered from step `first` on. */
static bev_status meet_target_without_more_deficit(bev_threshold_search *search, int32_t first) {
  const bev_requirement rest = {first, search->limits.trip->steps};
  bev_search_run *kept = &search->runs[BEV_KEPT_RUN];
  double spare_w = 0.0;
  double changed_spare_w = 0.0;
  bev_status status = bev_search_excess(search, kept, &rest, &spare_w);
  copy_run(search, &search->saved, kept, search->saved_shift_k, search->shift_k);
  if (status == BEV_OK) {
    status = meet_target(search, first);
  }
  if (status == BEV_OK) {
    status = bev_search_excess(search, kept, &rest, &changed_spare_w);
  }
  if (status == BEV_OK
      && bev_maximum(0.0, -changed_spare_w) > bev_maximum(0.0, -spare_w)) {
    copy_run(search, kept, &search->saved, search->shift_k, search->saved_shift_k);
  }
  return status;
}

/* Deliver one climb; the steps before `start` are settled. Advances `start` and `free_from`. */
static bev_status serve_climb(bev_threshold_search *search, const bev_requirement *climb,
                              int32_t *start, int32_t *free_from) {
  const bev_trip *trip = search->limits.trip;
  bev_search_run *kept = &search->runs[BEV_KEPT_RUN];
  double most_w = trip->idle_power_w[climb->first];
  double spare_w = 0.0;
  for (int32_t k = climb->first + 1; k < climb->last; k++) {
    most_w = bev_maximum(most_w, trip->idle_power_w[k]);
  }
  const double tolerance_w = BEV_POWER_SURPLUS * most_w;
  bev_status status = bev_search_excess(search, kept, climb, &spare_w);
  if (status == BEV_OK && spare_w > tolerance_w) {
    status = bev_search_drive(search, *start, climb->first, -BEV_CLIMB_OVERSHOOT_K, climb->last,
                              BEV_KEPT_RUN, 0);
    if (status == BEV_OK) {
      status = bev_search_excess(search, &search->runs[0], climb, &spare_w);
    }
    if (status == BEV_OK && spare_w > 0.0) {
      /* Delivered even with the thresholds lowered by the overshoot. */
      *start = climb->last;
      return BEV_OK;
    }
  }
  if (status == BEV_OK) {
    status = bev_search_move(search, *start, climb->first, climb, tolerance_w);
  }
  if (status == BEV_OK) {
    status = bev_search_excess(search, kept, climb, &spare_w);
  }
  if (status == BEV_OK && spare_w < 0.0) {
    /* Heating takes charge too: if charge is the cause of the deficit, heating makes it worse. */
    status = take_unheated_if_better(search, *start, climb->first, climb, spare_w);
  }
  *start = climb->last;
  *free_from = climb->last;
  return status;
}

static bev_status settle(bev_threshold_search *search) {
  const int32_t steps = search->limits.trip->steps;
  bev_requirement climbs[BEV_MOST_CLIMBS];
  int32_t count = 0;
  int32_t start = 0;
  int32_t free_from = 0;
  bev_status status =
      bev_search_drive(search, 0, 0, 0.0, steps, BEV_KEPT_RUN, BEV_KEPT_RUN);
  if (status == BEV_OK && search->goal->serves_climbs != 0) {
    status = bev_find_climbs(search->limits.vehicle, search->limits.trip,
                             search->runs[BEV_KEPT_RUN].states[0],
                             search->runs[BEV_KEPT_RUN].states[1], climbs, &count);
  }
  for (int32_t n = 0; status == BEV_OK && n < count; n++) {
    if (climbs[n].first > start) {
      status = serve_climb(search, &climbs[n], &start, &free_from);
    }
  }
  if (status == BEV_OK && free_from < start) {
    status = meet_target_without_more_deficit(search, free_from);
  }
  if (status == BEV_OK && start < steps) {
    status = meet_target(search, start);
  }
  if (status == BEV_OK && start > 0
      && search->runs[BEV_KEPT_RUN].states[1][steps] - search->goal->target_c < 0.0) {
    /* Heating after the last climb alone is not enough. */
    status = bev_search_move(search, 0, steps, &TARGET, BEV_ARRIVAL_TOLERANCE_K);
  }
  return status;
}

/* The step in which most of the heat of each step arrives. */
static void find_arrivals(const bev_trip *trip, double heat_lag_s, double *arrives_in_step) {
  int32_t into = 0;
  for (int32_t k = 0; k < trip->steps; k++) {
    while (into + 1 < trip->steps && trip->time_s[into + 1] <= trip->time_s[k] + heat_lag_s) {
      into++;
    }
    arrives_in_step[k] = (double)into;
  }
}

static bev_search_run run_in(double **memory, int32_t steps) {
  bev_search_run run;
  for (int32_t n = 0; n < 4; n++) {
    run.states[n] = bev_take(memory, steps + 1);
    run.powers_w[n] = bev_take(memory, steps);
  }
  run.wanted_w = bev_take(memory, steps);
  run.until = 0;
  run.stranding.step = -1;
  run.stranding.driven_share = 1.0;
  return run;
}

bev_status bev_settle(const bev_vehicle *vehicle, const bev_trip *trip, const bev_heating *heating,
                      const bev_settling *goal, double *states, double *powers_w,
                      bev_stranding *stranding, double *memory) {
  const bev_status checked = bev_checked(vehicle, trip, 0);
  if (checked != BEV_OK) {
    return checked;
  }
  if (!bev_is_heating(heating) || heating->bands == 0 || goal == NULL || states == NULL
      || powers_w == NULL || stranding == NULL || memory == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  const int32_t steps = trip->steps;
  const int32_t is_direct = bev_is_direct(vehicle);
  const int32_t rows = is_direct ? 2 : 4;
  for (int32_t n = 0; n < rows; n++) {
    if (!isfinite(states[n * (steps + 1)])) {
      return BEV_BAD_INPUT;
    }
  }
  if (!isfinite(goal->target_c)) {
    return BEV_BAD_INPUT;
  }
  bev_threshold_search search;
  search.limits = bev_limited_run_of(vehicle, trip, heating->may_overcharge,
                                     heating->may_overdraw, heating->takes_surplus,
                                     is_direct);
  search.heating = heating;
  search.goal = goal;
  search.rows = rows;
  search.arrives_in_step = bev_take(&memory, steps);
  search.shift_k = bev_take(&memory, steps);
  search.saved_shift_k = bev_take(&memory, steps);
  search.saved = run_in(&memory, steps);
  for (int32_t n = 0; n < BEV_SEARCH_RUNS; n++) {
    search.runs[n] = run_in(&memory, steps);
  }
  for (int32_t n = 0; n < rows; n++) {
    search.runs[BEV_KEPT_RUN].states[n] = &states[n * (steps + 1)];
    search.runs[BEV_KEPT_RUN].powers_w[n] = &powers_w[n * steps];
  }
  for (int32_t k = 0; k < steps; k++) {
    search.shift_k[k] = 0.0;
  }
  find_arrivals(trip, bev_heat_lag_s(vehicle), search.arrives_in_step);
  const bev_status status = settle(&search);
  *stranding = search.runs[BEV_KEPT_RUN].stranding;
  return status;
}
