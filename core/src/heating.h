/* SPDX-License-Identifier: Apache-2.0 */
/* When a run within limits heats, and how closely it keeps the limits. */
#ifndef BEV_PREHEAT_CORE_HEATING_H_
#define BEV_PREHEAT_CORE_HEATING_H_

#include "checks.h"
#include "parts_of_plans.h"

/* Maximum number of rounds for finding the command that keeps the highest temperature. */
#define BEV_MOST_HEATING_ROUNDS 1000

static inline int bev_is_heating(const bev_heating *heating) {
  return heating != NULL && heating->power_w != NULL && heating->may_overcharge != NULL
      && heating->may_overdraw != NULL && isnan(heating->below_c) == 0;
}

/* The heater power that is wanted in step k [W]. */
static inline double bev_wanted_w(const bev_heating *heating, int32_t k, double temperature_c) {
  return temperature_c < heating->below_c ? heating->power_w[k] : 0.0;
}

#endif /* BEV_PREHEAT_CORE_HEATING_H_ */
