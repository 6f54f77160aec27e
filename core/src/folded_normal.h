/* SPDX-License-Identifier: Apache-2.0 */
/* Mean magnitude of a normal variable, as in bev_preheat.numerics. */
#ifndef BEV_PREHEAT_CORE_FOLDED_NORMAL_H_
#define BEV_PREHEAT_CORE_FOLDED_NORMAL_H_

#include <math.h>

#include "bev_preheat_core_generated/constants.h"

static inline double bev_mean_magnitude(double mean, double variance) {
  const double magnitude = fabs(mean);
  const double certain = magnitude / BEV_CERTAIN_DEVIATIONS;
  if (!(variance > certain * certain)) {
    return magnitude;
  }
  const double deviation = sqrt(variance);
  const double ratio = magnitude / (BEV_ROOT_2 * deviation);
  const double standard = ratio < BEV_CERTAIN_DEVIATIONS ? ratio : BEV_CERTAIN_DEVIATIONS;
  return BEV_ROOT_2_OVER_PI * deviation * exp(-(standard * standard)) + magnitude * erf(standard);
}

#endif /* BEV_PREHEAT_CORE_FOLDED_NORMAL_H_ */
