/* SPDX-License-Identifier: Apache-2.0 */
/* The runs of a search for thresholds, and their shifts: bev_preheat.planning.threshold_search. */
#include <stdbool.h>

#include "bev_preheat_core_generated/constants.h"
#include "heating.h"
#include "step_limits.h"
#include "threshold_search.h"

/* The shift of the thresholds of step k, if `shift_k` is tried in steps first ... last - 1. */
static double shift_of(const bev_threshold_search *search, int32_t k, int32_t first, int32_t last,
                       double shift_k) {
  const double moved_k = search->shift_k[k];
  if (k < first || k >= last) {
    return moved_k;
  }
  /* A step that is moved for the second time never gets colder. */
  return moved_k == 0.0 ? shift_k : bev_maximum(moved_k, shift_k);
}

/* The heater power that is wanted in a step whose heat arrives in step k, with moved thresholds [W]. */
static double wanted_w(const bev_heating *heating, int32_t k, double power_w, double moved_k,
                       double temperature_c) {
  for (int32_t n = 0; n < heating->bands; n++) {
    const int32_t at = k * heating->bands + n;
    const double high_c = heating->high_c[at] + moved_k;
    if (heating->floor_c[at] <= temperature_c && temperature_c < high_c) {
      const double low_c = heating->low_c[at] + moved_k;
      return temperature_c <= low_c ? power_w
                                    : power_w * (high_c - temperature_c) / (high_c - low_c);
    }
  }
  return 0.0;
}

bev_status bev_search_drive(bev_threshold_search *search, int32_t first, int32_t last,
                            double shift_k, int32_t until, int32_t like, int32_t into) {
  const bev_heating *heating = search->heating;
  const bev_search_run *kept = &search->runs[BEV_KEPT_RUN];
  const bev_search_run *other = &search->runs[like];
  bev_search_run *run = &search->runs[into];
  const int32_t rows = search->rows;
  const int32_t start = kept->stranding.step < 0 ? first : 0;
  double here[4] = {0.0, 0.0, 0.0, 0.0};
  for (int32_t n = 0; n < rows; n++) {
    here[n] = kept->states[n][start];
    run->states[n][start] = here[n];
  }
  /* If the charge of a run runs out, that step is driven again. */
  const int32_t known = other->stranding.step < 0 ? other->until : other->stranding.step;
  bool is_like = like != into;
  run->until = until;
  run->stranding.step = -1;
  for (int32_t k = start; k < until; k++) {
    const int32_t arrives = (int32_t)search->arrives_in_step[k];
    const double asked_w =
        wanted_w(heating, arrives, heating->power_w[k],
                 shift_of(search, arrives, first, last, shift_k),
                 bev_settled_c(&search->limits, here));
    is_like = is_like && k < known && asked_w == other->wanted_w[k];
    run->wanted_w[k] = asked_w;
    if (is_like) {
      for (int32_t n = 0; n < rows; n++) {
        run->powers_w[n][k] = other->powers_w[n][k];
        here[n] = other->states[n][k + 1];
      }
    } else {
      double driven_w[4];
      const bev_status status =
          bev_drive_within_limits(&search->limits, k, here, asked_w, here, driven_w);
      if (status != BEV_OK && status != BEV_EMPTY) {
        return status;
      }
      for (int32_t n = 0; n < rows; n++) {
        run->powers_w[n][k] = driven_w[n];
      }
      if (status == BEV_EMPTY) {
        run->until = search->limits.trip->steps;
        run->stranding.step = k;
        return bev_strand(&search->limits, rows, run->states, run->powers_w, &run->stranding);
      }
    }
    for (int32_t n = 0; n < rows; n++) {
      run->states[n][k + 1] = here[n];
    }
  }
  return BEV_OK;
}

bev_status bev_search_excess(const bev_threshold_search *search, const bev_search_run *run,
                             const bev_requirement *required, double *excess) {
  const bev_trip *trip = search->limits.trip;
  if (required->first < 0) {
    *excess = run->states[1][trip->steps] - search->goal->target_c;
    return BEV_OK;
  }
  double least_w = INFINITY;
  for (int32_t k = required->first; k < required->last; k++) {
    double limits_w[2];
    const bev_status status =
        bev_limits_of_step(search->limits.vehicle, &run->states[0][k], &run->states[1][k],
                           trip->power_variance_w2[k], limits_w);
    if (status != BEV_OK) {
      return status;
    }
    double spare_w = limits_w[1] - trip->idle_power_w[k];
    if (!search->limits.is_direct) {
      /* A lagging heater still takes power after it is switched off. */
      spare_w = spare_w
          - run->states[2][k] * bev_mean_share_left(search->limits.lag_s, trip->duration_s[k]);
    }
    if (!isfinite(spare_w)) {
      return BEV_NOT_FINITE;
    }
    least_w = bev_minimum(least_w, spare_w);
  }
  *excess = least_w;
  return BEV_OK;
}

bev_status bev_search_keep(bev_threshold_search *search, int32_t first, int32_t last,
                           const bev_search_trial *trial) {
  const int32_t steps = search->limits.trip->steps;
  if (trial->run != BEV_KEPT_RUN) {
    /* Driven on to the end, as far as it is known. */
    const bev_status status = bev_search_drive(search, first, last, trial->shift_k, steps,
                                               trial->run, BEV_KEPT_RUN);
    if (status != BEV_OK) {
      return status;
    }
  }
  for (int32_t k = first; k < last; k++) {
    search->shift_k[k] = shift_of(search, k, first, last, trial->shift_k);
  }
  return BEV_OK;
}

static bev_status attempt_shift(bev_threshold_search *search, int32_t first, int32_t last, double shift_k,
                      const bev_requirement *required, int32_t like, int32_t into,
                      bev_search_trial *trial) {
  const int32_t until =
      required->first < 0 ? search->limits.trip->steps : required->last;
  bev_status status = bev_search_drive(search, first, last, shift_k, until, like, into);
  if (status == BEV_OK) {
    trial->shift_k = shift_k;
    trial->run = into;
    status = bev_search_excess(search, &search->runs[into], required, &trial->excess);
  }
  return status;
}

/* A trial run that is neither of two. */
static int32_t other_than(int32_t a, int32_t b) {
  for (int32_t run = 0; run < 2; run++) {
    if (run != a && run != b) {
      return run;
    }
  }
  return 2;
}

/* Weight of the side that does not move, once the other side's excess was `before`. */
static double left_of(double excess, double before) {
  const double left = before != 0.0 ? 1.0 - excess / before : 0.0;
  return left > 0.0 ? left : 0.5;
}

/* The last sufficient trial, between a sufficient and an insufficient trial. */
static bev_status close_in(bev_threshold_search *search, int32_t first, int32_t last,
                           const bev_requirement *required, double tolerance,
                           bev_search_trial *enough, const bev_search_trial *first_too_little) {
  bev_search_trial too_little = *first_too_little;
  const double aim = 0.5 * tolerance;
  double more = enough->excess - aim;
  double less = too_little.excess - aim;
  int was_enough = -1;
  for (int32_t n = 0; n < BEV_MOST_SEARCH_RUNS && !(enough->excess <= tolerance); n++) {
    const double shift_k =
        too_little.shift_k + less / (less - more) * (enough->shift_k - too_little.shift_k);
    const bool is_near_enough =
        fabs(enough->shift_k - shift_k) <= fabs(too_little.shift_k - shift_k);
    bev_search_trial trial;
    const bev_status status = attempt_shift(
        search, first, last, shift_k, required, is_near_enough ? enough->run : too_little.run,
        other_than(enough->run, too_little.run), &trial);
    if (status != BEV_OK) {
      return status;
    }
    const double excess = trial.excess - aim;
    const bool is_enough = trial.excess >= 0.0;
    if (is_enough) {
      less = less * (was_enough == 1 ? left_of(excess, more) : 1.0);
      more = excess;
      *enough = trial;
    } else {
      more = more * (was_enough == 0 ? left_of(excess, less) : 1.0);
      less = excess;
      too_little = trial;
    }
    was_enough = is_enough ? 1 : 0;
  }
  return BEV_OK;
}

bev_status bev_search_move(bev_threshold_search *search, int32_t first, int32_t last,
                           const bev_requirement *required, double tolerance) {
  static const double shifts_k[3] = {BEV_SMALL_SHIFT_K, BEV_LARGE_SHIFT_K, BEV_LARGEST_SHIFT_K};
  bev_search_trial here = {0.0, 0.0, BEV_KEPT_RUN};
  bev_status status =
      bev_search_excess(search, &search->runs[BEV_KEPT_RUN], required, &here.excess);
  if (status != BEV_OK || (0.0 <= here.excess && here.excess <= tolerance)) {
    return status;
  }
  bev_search_trial best = here;
  const double direction = here.excess < 0.0 ? 1.0 : -1.0;
  for (int32_t n = 0; n < 3; n++) {
    bev_search_trial there;
    status = attempt_shift(search, first, last, direction * shifts_k[n], required, here.run,
                 other_than(here.run, best.run), &there);
    if (status != BEV_OK) {
      return status;
    }
    if (there.excess * here.excess <= 0.0) {
      /* Aim at the middle of the tolerance band: an excess on either side ends the search. */
      bev_search_trial enough = here.excess < 0.0 ? there : here;
      status = close_in(search, first, last, required, tolerance, &enough,
                        here.excess < 0.0 ? &here : &there);
      return status == BEV_OK ? bev_search_keep(search, first, last, &enough) : status;
    }
    here = there;
    /* Heating takes charge too, and an emptier battery delivers less: more is not better. */
    if (fabs(there.excess) < fabs(best.excess)) {
      best = there;
    }
  }
  return bev_search_keep(search, first, last, &best);
}
