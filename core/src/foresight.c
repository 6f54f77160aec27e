/* SPDX-License-Identifier: Apache-2.0 */
/* Looks ahead along a trip, with the limits of the battery's state now: bev_preheat.planning.heated_limits. */
#include "foresight.h"

#include "bev_preheat_core_generated/constants.h"

/* The last step that begins within `duration_s` after the end of step k. */
static int32_t last_after(const bev_trip *trip, int32_t k, double duration_s) {
  double left_s = duration_s;
  for (int32_t last = k; last + 1 < trip->steps; last++) {
    if (!(left_s > 0.0)) {
      return last;
    }
    left_s -= trip->duration_s[last + 1];
  }
  return trip->steps - 1;
}

static int is_before_climb(const bev_limited_run *run, int32_t k) {
  const bev_trip *trip = run->trip;
  const double until_s = trip->time_s[k + 1] + BEV_LAGS_AHEAD * run->lag_s;
  for (int32_t j = k + 1; j < trip->steps; j++) {
    if (!(trip->time_s[j] < until_s)) {
      return 0;
    }
    if (run->may_overdraw[j] != 0u && trip->time_s[j] > trip->time_s[k]) {
      return 1;
    }
  }
  return 0;
}

double bev_off_in_time_w(const bev_limited_run *run, int32_t k, const double states[4]) {
  const bev_trip *trip = run->trip;
  if (!is_before_climb(run, k)) {
    return INFINITY;
  }
  double allowed_w = INFINITY;
  for (int32_t j = last_after(trip, k, BEV_LAGS_AHEAD * run->lag_s); j > k; j--) {
    const double decay = exp(-trip->duration_s[j] / run->lag_s);
    allowed_w = decay > 0.0 ? allowed_w / decay : INFINITY;
    if (run->may_overdraw[j] != 0u) {
      double limits_w[2];
      bev_terminal_limits(run->vehicle, 0, states[0], states[1],
                          trip->power_variance_w2[j], limits_w);
      allowed_w = bev_minimum(
          allowed_w, bev_maximum(limits_w[1] - trip->idle_power_w[j], 0.0)
              / bev_mean_share_left(run->lag_s, trip->duration_s[j]));
    }
  }
  const double decay = exp(-trip->duration_s[k] / run->lag_s);
  return (allowed_w - decay * states[2]) / (1.0 - decay);
}

double bev_lasting_surplus_w(const bev_limited_run *run, int32_t k, const double states[4]) {
  const bev_trip *trip = run->trip;
  const double ahead_s = BEV_LASTING_LAGS * run->lag_s - 0.5 * trip->duration_s[k];
  const int32_t last = last_after(trip, k, ahead_s);
  if (last == k) {
    return INFINITY;
  }
  double lasting_s = 0.0;
  double least_w = INFINITY;
  for (int32_t j = k + 1; j <= last; j++) {
    double limits_w[2];
    lasting_s += trip->duration_s[j];
    bev_terminal_limits(run->vehicle, 0, states[0], states[1],
                        trip->power_variance_w2[j], limits_w);
    least_w = bev_minimum(least_w, limits_w[0] - trip->idle_power_w[j]);
  }
  return lasting_s < ahead_s ? 0.0 : bev_maximum(0.0, least_w);
}
