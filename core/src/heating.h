/* SPDX-License-Identifier: Apache-2.0 */
/* When a run within limits heats, and how closely it keeps the limits. */
#ifndef BEV_PREHEAT_CORE_HEATING_H_
#define BEV_PREHEAT_CORE_HEATING_H_

#include "checks.h"

/* Maximum number of rounds for finding the command that keeps the highest temperature. */
#define BEV_MOST_HEATING_ROUNDS 1000

static inline int bev_is_heating(const bev_heating *heating) {
  return heating != NULL && heating->power_w != NULL && heating->may_overcharge != NULL
      && heating->may_overdraw != NULL
      && (heating->bands == 0
          || (heating->bands > 0 && heating->bands <= BEV_BANDS && heating->floor_c != NULL
              && heating->low_c != NULL && heating->high_c != NULL));
}

/* The heater power that is wanted in step k [W]. */
static inline double bev_wanted_w(const bev_heating *heating, int32_t k, double temperature_c) {
  const double power_w = heating->power_w[k];
  if (heating->bands == 0) {
    return power_w;
  }
  for (int32_t n = 0; n < heating->bands; n++) {
    const int32_t at = k * heating->bands + n;
    const double low_c = heating->low_c[at];
    const double high_c = heating->high_c[at];
    if (heating->floor_c[at] <= temperature_c && temperature_c < high_c) {
      return temperature_c <= low_c ? power_w
                                    : power_w * (high_c - temperature_c) / (high_c - low_c);
    }
  }
  return 0.0;
}

#endif /* BEV_PREHEAT_CORE_HEATING_H_ */
