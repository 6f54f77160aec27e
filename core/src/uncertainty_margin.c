/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Heating a little earlier than a plan needs, as a margin for a drive that turns out worse:
 * bev_preheat.planning.uncertainty_margin for a run that is heated from one instant on, heat at once, no limit active.
 */
#include "uncertainty_margin.h"

#include "bev_preheat_core_generated/constants.h"
#include "bracketing.h"
#include "early_start.h"
#include "steps_of_model.h"

/* A heating interval that begins at `start_s`, and its end in the current run [s]. */
typedef struct {
  const bev_heated_run *run;
  double start_s;
  double end_s;
} search;

/* The run that is driven on from a step. */
static bev_status run_on(const bev_heated_run *run, int32_t first) {
  return bev_run_with_means(run->vehicle, BEV_RUNGE_KUTTA_4, run->trip, first, run->heater_w, NULL,
                            run->soc, run->temperature_c, run->means);
}

/* The run heated until an instant; its excess over the target on arrival. */
static bev_status heat_early_until(void *searched, double end_s, double *above_k) {
  search *of = (search *)searched;
  const bev_heated_run *run = of->run;
  const bev_trip *trip = run->trip;
  /* Until the earlier of both ends, the current run is unchanged. */
  const int32_t first = bev_step_at(trip, bev_minimum(of->end_s, end_s));
  bev_heat_between(trip, first, of->start_s, end_s, run->heater_w);
  of->end_s = end_s;
  const bev_status status = run_on(run, first);
  *above_k = run->temperature_c[trip->steps] - run->target_c;
  return status;
}

/* The run without the interval that begins in a step. */
static bev_status leave_out(const bev_heated_run *run, int32_t first, bev_early_interval *interval) {
  for (int32_t k = first; k < run->trip->steps; k++) {
    run->heater_w[k] = 0.0;
  }
  interval->first = first;
  return run_on(run, first);
}

/* The run that is heated from an instant on, for as long as it needs; about until `guess_s`. */
static bev_status heat_early_from(const bev_heated_run *run, double start_s, double guess_s,
                            bev_early_interval *interval) {
  const double arrival_s = run->trip->time_s[run->trip->steps];
  /* At first, everything after the start must be computed. */
  search of = {run, start_s, start_s};
  double end_s = bev_minimum(bev_maximum(guess_s, start_s), arrival_s);
  double above_k = 0.0;
  bev_status status = heat_early_until(&of, end_s, &above_k);
  if (status < BEV_OK) {
    return status;
  }
  const bev_ending ending = {BEV_EARLY_TOLERANCE_K, BEV_EARLY_RESOLUTION_S, BEV_MOST_EARLY_RUNS};
  status = bev_follow_slope(arrival_s, start_s, bev_warmed_k_per_s(run->vehicle, run->trip, end_s),
                            &ending, heat_early_until, &of, &end_s, &above_k);
  interval->first = bev_step_at(run->trip, start_s);
  interval->start_s = end_s > start_s ? start_s : NAN;
  interval->end_s = start_s < end_s && end_s < arrival_s ? end_s : NAN;
  return status;
}

bev_status bev_switch_on_early(const bev_heated_run *run, const bev_uncertainty_margin *margin,
                               bev_early_interval *interval) {
  const bev_trip *trip = run->trip;
  const bev_planned_heating planned = {run->vehicle, trip, run->heater_w,
                                       trip->time_s[trip->steps]};
  bev_early_start start;
  interval->first = trip->steps;
  interval->start_s = NAN;
  interval->end_s = NAN;
  const bev_status status = bev_find_early_start(&planned, margin, &start);
  if (status != BEV_OK || start.change == BEV_STAYS) {
    return status;
  }
  return start.change == BEV_LEFT_OUT
      ? leave_out(run, start.first, interval)
      : heat_early_from(run, start.start_s, start.guess_s, interval);
}
