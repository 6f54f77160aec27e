/* SPDX-License-Identifier: Apache-2.0 */
/* The battery's limits on the power of one step: bev_preheat.planning.dynamics.limits_of_steps_w. */
#ifndef BEV_PREHEAT_CORE_STEP_LIMITS_H_
#define BEV_PREHEAT_CORE_STEP_LIMITS_H_

#include "bev_preheat_core_generated/constants.h"
#include "steps_of_model.h"

/* The least and the most terminal power [W] that keep the limits at both ends of a step, start and end given. */
static inline bev_status bev_limits_of_step(const bev_vehicle *vehicle, const double soc[2],
                                            const double temperature_c[2], double variance_w2,
                                            double limits_w[2]) {
  double end_w[2];
  bev_terminal_limits(vehicle, BEV_AS_ARRAYS, soc[0], temperature_c[0], variance_w2, limits_w);
  bev_terminal_limits(vehicle, BEV_AS_ARRAYS, soc[1], temperature_c[1], variance_w2, end_w);
  if (!isfinite(limits_w[0]) || !isfinite(limits_w[1]) || !isfinite(end_w[0])
      || !isfinite(end_w[1])) {
    return BEV_NOT_FINITE;
  }
  limits_w[0] = bev_maximum(limits_w[0], end_w[0]);
  limits_w[1] = bev_minimum(limits_w[1], end_w[1]);
  return BEV_OK;
}

/* The same for a battery BEV_COLDER_BY_K colder, but not below the vehicle's range: a limit may matter there. */
static inline bev_status bev_limits_of_colder_step(const bev_vehicle *vehicle, const double soc[2],
                                                   const double temperature_c[2],
                                                   double variance_w2, double limits_w[2]) {
  const double colder_c[2] = {
      bev_maximum(temperature_c[0] - BEV_COLDER_BY_K, vehicle->lowest_c),
      bev_maximum(temperature_c[1] - BEV_COLDER_BY_K, vehicle->lowest_c)};
  return bev_limits_of_step(vehicle, soc, colder_c, variance_w2, limits_w);
}

/* Number of steps computed side by side. */
#define BEV_LIMITS_BLOCK BEV_BLOCK

#endif /* BEV_PREHEAT_CORE_STEP_LIMITS_H_ */
