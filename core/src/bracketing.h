/* SPDX-License-Identifier: Apache-2.0 */
/* Searches between a value with too much and one with too little: bev_preheat.planning.bracketing. */
#ifndef BEV_PREHEAT_CORE_BRACKETING_H_
#define BEV_PREHEAT_CORE_BRACKETING_H_

#include <math.h>
#include <stdint.h>

#include "bev_preheat_core/core.h"

/* When a search ends: tolerance of the excess about 0, resolution of the value, maximum number of trials. */
typedef struct {
  double tolerance;
  double resolution;
  int32_t most_trials;
} bev_ending;

/* Tries a value and writes the excess of its result over the requirement. Below BEV_OK it has failed. */
typedef bev_status (*bev_attempt)(void *of, double value, double *excess);

/*
 * The value whose excess is within a tolerance of 0; the last that is tried. `value` and `excess` are the first
 * trial, and the last one afterwards. The excess is greatest at `most`, which is returned if it is not enough,
 * and falls towards `least`: a secant, confined to the bracket.
 */
static inline bev_status bev_follow_slope(double most, double least, double first_slope, const bev_ending *ending,
                                          bev_attempt attempt, void *of, double *value, double *excess) {
  const double direction = most > least ? 1.0 : -1.0;
  double enough = most;
  double too_little = least;
  double slope = first_slope;
  for (int32_t n = 0; n < ending->most_trials; n++) {
    if (!isfinite(*excess)) {
      return BEV_NOT_FINITE;
    }
    if (fabs(*excess) <= ending->tolerance || (*value == most && *excess < 0.0)) {
      return BEV_OK;
    }
    if (*excess > 0.0) {
      enough = *value;
    } else {
      too_little = *value;
    }
    const double low = enough < too_little ? enough : too_little;
    const double high = enough < too_little ? too_little : enough;
    double following = slope * direction > 0.0 ? *value - *excess / slope : NAN;
    if (enough == most && (following - most) * direction >= 0.0) {
      /* Only a trial shows whether the utmost is enough. */
      following = most;
    } else if (!(low < following && following < high)) {
      following = 0.5 * (enough + too_little);
    } else {
      /* Follow the slope. */
    }
    if (fabs(following - *value) <= ending->resolution) {
      return BEV_OK;
    }
    const double value_before = *value;
    const double excess_before = *excess;
    *value = following;
    const bev_status status = attempt(of, following, excess);
    if (status < BEV_OK) {
      return status;
    }
    slope = (*excess - excess_before) / (*value - value_before);
  }
  return BEV_OK;
}

#endif /* BEV_PREHEAT_CORE_BRACKETING_H_ */
