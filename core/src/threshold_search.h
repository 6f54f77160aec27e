/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Forward runs that heat below thresholds, shifted so that they meet their requirements exactly:
 * bev_preheat.planning.threshold_search, which documents the constants and the reasons for them.
 */
#ifndef BEV_PREHEAT_CORE_THRESHOLD_SEARCH_H_
#define BEV_PREHEAT_CORE_THRESHOLD_SEARCH_H_

#include "bev_preheat_core_generated/constants.h"
#include "trajectory.h"
#include "limited_step.h"

/* The retained run, and three trial runs. */
#define BEV_SEARCH_RUNS 4
#define BEV_KEPT_RUN 3

/* One run: arrays over instants and steps, and the wanted heater power in each step; known before `until`. */
typedef struct {
  double *states[4];
  double *powers_w[4];
  double *wanted_w;
  int32_t until;
  bev_stranding stranding;
} bev_search_run;

typedef struct {
  bev_limited_run limits;
  const bev_heating *heating;
  const bev_settling *goal;
  /* Number of states and of powers. */
  int32_t rows;
  /* The step in which most of the heat of each step arrives; as a double, so that one memory is enough. */
  double *arrives_in_step;
  /* Shift of the thresholds of each step. */
  double *shift_k;
  bev_search_run runs[BEV_SEARCH_RUNS];
  /* The run to restore if a change turns out worse. */
  bev_search_run saved;
  double *saved_shift_k;
} bev_threshold_search;

/* Requirement of a run: enough power in steps first ... last - 1, or (first < 0) the target. */
typedef struct {
  int32_t first;
  int32_t last;
} bev_requirement;

/* Intervals of a run whose power a slightly colder battery could not deliver. */
bev_status bev_find_climbs(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                           const double *temperature_c,
                           bev_requirement climbs[BEV_MOST_CLIMBS], int32_t *count);

/* A shift that was tried, its run, and the excess over the requirement. */
typedef struct {
  double shift_k;
  double excess;
  int32_t run;
} bev_search_trial;

/*
 * Drive run `into` from step `first` on, the thresholds before step `last` moved by `shift_k`, until step
 * `until`. As far as run `like` was to be heated with the same, it is copied. A run instead of one whose
 * charge runs out is driven from its beginning.
 */
bev_status bev_search_drive(bev_threshold_search *search, int32_t first, int32_t last,
                            double shift_k, int32_t until, int32_t like, int32_t into);

/* Excess of a run over a requirement. */
bev_status bev_search_excess(const bev_threshold_search *search, const bev_search_run *run,
                             const bev_requirement *required, double *excess);

/*
 * Move the thresholds in steps first ... last - 1 until the kept run's excess is about 0: within the
 * tolerance above it, or as close to it as shifts get.
 */
bev_status bev_search_move(bev_threshold_search *search, int32_t first, int32_t last,
                           const bev_requirement *required, double tolerance);

/* Keep a trial of steps first ... last - 1. */
bev_status bev_search_keep(bev_threshold_search *search, int32_t first, int32_t last,
                           const bev_search_trial *trial);

#endif /* BEV_PREHEAT_CORE_THRESHOLD_SEARCH_H_ */
