/* SPDX-License-Identifier: Apache-2.0 */
/* The columns of a bev_preheat.route.segments.Route, in their order. */
#ifndef BEV_PREHEAT_CORE_ROUTE_COLUMNS_H_
#define BEV_PREHEAT_CORE_ROUTE_COLUMNS_H_

#include "arithmetic.h"

enum {
  BEV_ROUTE_DURATION,
  BEV_ROUTE_SPEED,
  BEV_ROUTE_PROPULSION,
  BEV_ROUTE_RMS,
  BEV_ROUTE_AMBIENT,
  BEV_ROUTE_CABIN,
  BEV_ROUTE_AUXILIARY,
  BEV_ROUTE_MAGNITUDE,
  BEV_ROUTE_COLUMNS
};

/* Variance [W^2] of a power with this root mean square and mean [W]. */
static inline double bev_power_variance_w2(double rms_w, double mean_w) {
  return bev_maximum(rms_w * rms_w - mean_w * mean_w, 0.0);
}

#endif /* BEV_PREHEAT_CORE_ROUTE_COLUMNS_H_ */
