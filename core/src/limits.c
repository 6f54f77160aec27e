/* SPDX-License-Identifier: Apache-2.0 */
/* The battery's limits along a run: terminal_limits_w and limits_of_steps_w of bev_preheat.planning.dynamics. */
#include "checks.h"
#include "steps_of_model.h"

bev_status bev_limits_along(const bev_vehicle *vehicle, int32_t count, const double *soc,
                            const double *temperature_c, const double *variance_w2,
                            double *least_w, double *most_w) {
  if (vehicle == NULL || soc == NULL || temperature_c == NULL || variance_w2 == NULL
      || least_w == NULL || most_w == NULL || count < 0 || count > BEV_MOST_STEPS) {
    return BEV_BAD_ARGUMENT;
  }
  if (!bev_is_vehicle(vehicle)) {
    return BEV_BAD_VEHICLE;
  }
  for (int32_t n = 0; n < count; n++) {
    double limits_w[2];
    bev_terminal_limits(vehicle, BEV_AS_ARRAYS, soc[n], temperature_c[n], variance_w2[n],
                        limits_w);
    if (!isfinite(limits_w[0]) || !isfinite(limits_w[1])) {
      return BEV_NOT_FINITE;
    }
    least_w[n] = limits_w[0];
    most_w[n] = limits_w[1];
  }
  return BEV_OK;
}

bev_status bev_limits_of_steps(const bev_vehicle *vehicle, int32_t steps, const double *soc,
                               const double *temperature_c, const double *variance_w2,
                               double *least_w, double *most_w) {
  if (vehicle == NULL || soc == NULL || temperature_c == NULL || variance_w2 == NULL
      || least_w == NULL || most_w == NULL || steps < 0 || steps > BEV_MOST_STEPS) {
    return BEV_BAD_ARGUMENT;
  }
  if (!bev_is_vehicle(vehicle)) {
    return BEV_BAD_VEHICLE;
  }
  double end_w[2] = {0.0, 0.0};
  for (int32_t k = 0; k < steps; k++) {
    double start_w[2] = {end_w[0], end_w[1]};
    if (k == 0 || variance_w2[k] != variance_w2[k - 1]) {
      bev_terminal_limits(vehicle, BEV_AS_ARRAYS, soc[k], temperature_c[k], variance_w2[k],
                          start_w);
    }
    bev_terminal_limits(vehicle, BEV_AS_ARRAYS, soc[k + 1], temperature_c[k + 1], variance_w2[k],
                        end_w);
    least_w[k] = bev_maximum(start_w[0], end_w[0]);
    most_w[k] = bev_minimum(start_w[1], end_w[1]);
    if (!isfinite(start_w[0]) || !isfinite(start_w[1]) || !isfinite(end_w[0])
        || !isfinite(end_w[1])) {
      return BEV_NOT_FINITE;
    }
  }
  return BEV_OK;
}
