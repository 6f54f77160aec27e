/* SPDX-License-Identifier: Apache-2.0 */
/* The columns of a trip from those of a route: bev_preheat.planning.trip. */
#include "bev_preheat_core_generated/constants.h"
#include "bev_preheat_core_generated/drives.h"
#include "checks.h"
#include "route_columns.h"

/* The columns of a trip, in their order. */
enum {
  STEP_DURATION,
  IDLE_POWER,
  VARIANCE,
  IDLE_HEAT,
  LEAKAGE,
  HEATER_LIMIT,
  STEP_PROPULSION,
  DRIVETRAIN_HEAT,
  STEP_AMBIENT,
  TRIP_COLUMNS
};

static bev_status make_steps(const bev_trip_terms *terms, int32_t steps,
                             const double *const from[BEV_ROUTE_COLUMNS], double *time_s,
                             double *const to[TRIP_COLUMNS]) {
  time_s[0] = 0.0;
  for (int32_t k = 0; k < steps; k++) {
    const double duration_s = from[BEV_ROUTE_DURATION][k];
    const double power_w = from[BEV_ROUTE_PROPULSION][k];
    const double leakage_w_per_k =
        bev_leakage_w_per_k(terms, from[BEV_ROUTE_SPEED][k]);
    const double drivetrain_heat_w =
        bev_drivetrain_heat_w(terms, from[BEV_ROUTE_MAGNITUDE][k]);
    const double longest_s = leakage_w_per_k <= terms->stiff_w_per_k
        ? BEV_LONGEST_STEP_S
        : BEV_LONGEST_STEP_S * (terms->stiff_w_per_k / leakage_w_per_k);
    if (!(duration_s <= longest_s)) {
      return BEV_BAD_INPUT;
    }
    time_s[k + 1] = time_s[k] + duration_s;
    to[STEP_DURATION][k] = duration_s;
    to[IDLE_POWER][k] =
        bev_idle_power_w(power_w, from[BEV_ROUTE_CABIN][k], from[BEV_ROUTE_AUXILIARY][k]);
    to[VARIANCE][k] = bev_power_variance_w2(from[BEV_ROUTE_RMS][k], power_w);
    to[IDLE_HEAT][k] =
        bev_idle_heat_w(leakage_w_per_k, from[BEV_ROUTE_AMBIENT][k], drivetrain_heat_w);
    to[LEAKAGE][k] = leakage_w_per_k;
    to[HEATER_LIMIT][k] =
        terms->heater_share * bev_maximum(terms->heater_w - from[BEV_ROUTE_CABIN][k], 0.0);
    to[STEP_PROPULSION][k] = power_w;
    to[DRIVETRAIN_HEAT][k] = drivetrain_heat_w;
    to[STEP_AMBIENT][k] = from[BEV_ROUTE_AMBIENT][k];
  }
  return BEV_OK;
}

bev_status bev_make_trip(const bev_trip_terms *terms, int32_t steps, const double *route, double *columns) {
  if (terms == NULL || steps < 1 || steps > BEV_MOST_STEPS || route == NULL || columns == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  const double *from[BEV_ROUTE_COLUMNS];
  double *to[TRIP_COLUMNS];
  for (int32_t n = 0; n < BEV_ROUTE_COLUMNS; n++) {
    from[n] = &route[n * steps];
  }
  for (int32_t n = 0; n < TRIP_COLUMNS; n++) {
    to[n] = &columns[steps + 1 + n * steps];
  }
  const bev_status status = make_steps(terms, steps, from, columns, to);
  if (status == BEV_OK && terms->heat_lag_s > 0.0) {
    /* A step whose heat would mostly come too late is not heated. */
    for (int32_t k = 0; k < steps; k++) {
      if (!(columns[steps] - columns[k + 1] + 0.5 * route[k] > terms->heat_lag_s)) {
        to[HEATER_LIMIT][k] = 0.0;
      }
    }
  }
  return status;
}
