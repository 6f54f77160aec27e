/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Heating a little earlier than a plan needs, so that what turns out worse can be made up for:
 * bev_preheat.planning.caution for a run that is heated from one instant on, heat at once, no limit active.
 */
#include "caution.h"

#include "bracketing.h"
#include "steps_of_model.h"

/* The end of heating is found to this, in so many runs. */
#define ARRIVAL_TOLERANCE_K 1e-3
#define END_RESOLUTION_S 1e-3
#define MOST_RUNS 12

/* A stretch of heating that begins at `start_s`, and until when it is heated in the run that is there [s]. */
typedef struct {
  const bev_heated_run *run;
  double start_s;
  double end_s;
} search;

/* The first step of the heating that lasts until arrival; `steps` without. */
static int32_t first_of_last_stretch(const bev_heated_run *run) {
  const bev_trip *trip = run->trip;
  int32_t first = trip->steps;
  for (int32_t k = trip->steps - 1; k >= 0; k--) {
    /* Steps in which nothing can be heated are no pause. */
    if (!(trip->heater_limit_w[k] > 0.0)) {
      continue;
    }
    if (!bev_is_heated(trip, run->heater_w, k)) {
      break;
    }
    first = k;
  }
  return first;
}

/* The most heat that the heater can give in a step: [W], and over all of it [J]. */
static double heat_w(const bev_heated_run *run, int32_t k) {
  return run->vehicle->heater_efficiency * run->trip->heater_limit_w[k];
}

static double heat_j(const bev_heated_run *run, int32_t k) {
  return heat_w(run, k) * run->trip->duration_s[k];
}

/* The most heat that the heater can give until an instant [J]. */
static double given_until_j(const bev_heated_run *run, double until_s) {
  const bev_trip *trip = run->trip;
  const int32_t before = bev_points_up_to(trip->time_s, trip->steps + 1, until_s) - 1;
  double given_j = 0.0;
  for (int32_t k = 0; k < before; k++) {
    given_j = given_j + heat_j(run, k);
  }
  if (before < 0 || before >= trip->steps) {
    return given_j;
  }
  const double slope_w = (given_j + heat_j(run, before) - given_j)
      / (trip->time_s[before + 1] - trip->time_s[before]);
  return slope_w * (until_s - trip->time_s[before]) + given_j;
}

/* The instant [s] from which the heater gives `lead_k` by `until_s`; NaN where there is none. */
static double earlier_s(const bev_heated_run *run, double until_s, double lead_k) {
  const bev_trip *trip = run->trip;
  if (lead_k <= 0.0) {
    return until_s;
  }
  const double wanted_j = bev_maximum(
      0.0, given_until_j(run, until_s) - lead_k * run->vehicle->heat_capacity_j_per_k);
  double given_j = 0.0;
  for (int32_t k = 0; k < trip->steps; k++) {
    const double following_j = given_j + heat_j(run, k);
    if (following_j > wanted_j) {
      /* The last step that begins with no more than that gives some, so its power is not 0. */
      return bev_minimum(trip->time_s[k] + (wanted_j - given_j) / heat_w(run, k), until_s);
    }
    given_j = following_j;
  }
  return NAN;
}

/* How much warmer the battery arrives for each second that heating lasts longer, about. */
static double warmed_k_per_s(const bev_heated_run *run, double end_s) {
  const bev_trip *trip = run->trip;
  const int32_t step = bev_step_at(trip, end_s);
  const double capacity = run->vehicle->heat_capacity_j_per_k;
  const double left =
      exp(-trip->leakage_w_per_k[step] / capacity * (trip->time_s[trip->steps] - end_s));
  return heat_w(run, step) / capacity * left;
}

/* The run that is driven on from a step. */
static bev_status run_on(const bev_heated_run *run, int32_t first) {
  return bev_run_with_means(run->vehicle, BEV_RUNGE_KUTTA_4, run->trip, first, run->heater_w, NULL,
                            run->soc, run->temperature_c, run->means);
}

/* The run that is heated until an instant, above the target on arrival. */
static bev_status heat_early_until(void *searched, double end_s, double *above_k) {
  search *of = (search *)searched;
  const bev_heated_run *run = of->run;
  const bev_trip *trip = run->trip;
  /* Until the earlier of both ends it is the run that is there. */
  const int32_t first = bev_step_at(trip, bev_minimum(of->end_s, end_s));
  for (int32_t k = first; k < trip->steps; k++) {
    const double heated_s =
        bev_minimum(trip->time_s[k + 1], end_s) - bev_maximum(trip->time_s[k], of->start_s);
    run->heater_w[k] = bev_minimum(bev_maximum(heated_s / trip->duration_s[k], 0.0), 1.0)
        * trip->heater_limit_w[k];
  }
  of->end_s = end_s;
  const bev_status status = run_on(run, first);
  *above_k = run->temperature_c[trip->steps] - run->target_c;
  return status;
}

/* The run without the stretch that begins in a step. */
static bev_status leave_out(const bev_heated_run *run, int32_t first, bev_early_stretch *stretch) {
  for (int32_t k = first; k < run->trip->steps; k++) {
    run->heater_w[k] = 0.0;
  }
  stretch->first = first;
  return run_on(run, first);
}

/* The run that is heated from an instant on, for as long as it needs; about until `guess_s`. */
static bev_status heat_early_from(const bev_heated_run *run, double start_s, double guess_s,
                            bev_early_stretch *stretch) {
  const double arrival_s = run->trip->time_s[run->trip->steps];
  /* At first nothing after the start is as it is to be. */
  search of = {run, start_s, start_s};
  double end_s = bev_minimum(bev_maximum(guess_s, start_s), arrival_s);
  double above_k = 0.0;
  bev_status status = heat_early_until(&of, end_s, &above_k);
  if (status < BEV_OK) {
    return status;
  }
  const bev_ending ending = {ARRIVAL_TOLERANCE_K, END_RESOLUTION_S, MOST_RUNS};
  status = bev_follow_slope(arrival_s, start_s, warmed_k_per_s(run, end_s), &ending, heat_early_until, &of,
                            &end_s, &above_k);
  stretch->first = bev_step_at(run->trip, start_s);
  stretch->start_s = end_s > start_s ? start_s : NAN;
  stretch->end_s = start_s < end_s && end_s < arrival_s ? end_s : NAN;
  return status;
}

bev_status bev_heat_early(const bev_heated_run *run, const bev_caution *caution,
                          bev_early_stretch *stretch) {
  const bev_trip *trip = run->trip;
  const double arrival_s = trip->time_s[trip->steps];
  const int32_t first = first_of_last_stretch(run);
  stretch->first = trip->steps;
  stretch->start_s = NAN;
  stretch->end_s = NAN;
  if (first == trip->steps) {
    return BEV_OK;
  }
  /* A first step that is heated in part is off first, then at full power to its end. */
  const double share_on = bev_minimum(run->heater_w[first] / trip->heater_limit_w[first], 1.0);
  const double start_s = trip->time_s[first + 1] - share_on * trip->duration_s[first];
  if (caution->is_heating == 0 && arrival_s - start_s < caution->least_heating_s) {
    return leave_out(run, first, stretch);
  }
  double early_s = earlier_s(run, start_s, caution->lead_k);
  if (caution->is_heating != 0 && early_s <= caution->least_pause_s) {
    early_s = 0.0;
  }
  if (isnan(early_s) != 0) {
    return BEV_NOT_FINITE;
  }
  if (early_s >= start_s) {
    return BEV_OK;
  }
  /* What is heated earlier need not be heated later. */
  return heat_early_from(run, early_s, arrival_s - (start_s - early_s), stretch);
}
