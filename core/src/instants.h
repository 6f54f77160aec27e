/* SPDX-License-Identifier: Apache-2.0 */
/* When a run heats: bev_preheat.planning.schedule, and the runs within limits of bev_preheat.planning.limits. */
#ifndef BEV_PREHEAT_CORE_INSTANTS_H_
#define BEV_PREHEAT_CORE_INSTANTS_H_

#include "steps_of_model.h"

/* The first instant of heating [s] in the steps first ... last - 1 under commands [W]; NaN without any. */
static inline double bev_switched_on_s(const bev_trip *trip, const double *command_w,
                                       int32_t first, int32_t last) {
  for (int32_t k = first; k < last; k++) {
    if (bev_is_heated(trip, command_w, k) != 0) {
      /* A first step heated in part is off first, then at full power to its end. */
      const double share_on = bev_minimum(command_w[k] / trip->heater_limit_w[k], 1.0);
      return trip->time_s[k + 1] - share_on * trip->duration_s[k];
    }
  }
  return NAN;
}

/* The same for a run within limits; `watched`, 2 * steps bytes, marks the steps whose limits were checked. */
static inline double bev_switched_on_within_limits_s(const bev_trip *trip,
                                                     const double *command_w,
                                                     const uint8_t *watched) {
  const double start_s = bev_switched_on_s(trip, command_w, 0, trip->steps);
  if (isnan(start_s) != 0) {
    return start_s;
  }
  const int32_t on = bev_step_at(trip, start_s);
  /* A step heated in part because of a limit is heated evenly, from its beginning. */
  return watched[on] != 0u || watched[trip->steps + on] != 0u ? trip->time_s[on] : start_s;
}

/* The end of the last heated step [s]; NaN if it is the arrival, or if no step is heated. */
static inline double bev_ends_before_arrival_s(const bev_trip *trip, const double *command_w) {
  for (int32_t k = trip->steps - 1; k >= 0; k--) {
    if (bev_is_heated(trip, command_w, k) != 0) {
      return k + 1 < trip->steps ? trip->time_s[k + 1] : NAN;
    }
  }
  return NAN;
}

#endif /* BEV_PREHEAT_CORE_INSTANTS_H_ */
