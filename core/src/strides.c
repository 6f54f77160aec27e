/* SPDX-License-Identifier: Apache-2.0 */
/* Where each stride of a trip leads from each temperature: bev_preheat.planning.strides. */
#include "checks.h"
#include "steps_of_model.h"

#define LEAST_WIDTH_K 1e-9

/* One stride from one temperature: what its limits leave. */
typedef struct {
  double surplus_w;
  double lacking_w;
  double room_w;
} margins;

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

static margins margins_of(const bev_vehicle *vehicle, const bev_stride_inputs *inputs, int32_t m,
                          double start_c) {
  const double limit_w = inputs->heater_limit_w[m];
  margins found = {0.0, 0.0, limit_w};
  if (inputs->is_limited[m] != 0) {
    const double power_w = inputs->idle_power_w[m];
    double limits_w[2];
    bev_terminal_limits(vehicle, BEV_AS_ARRAYS, inputs->soc[m], start_c,
                        inputs->power_variance_w2[m], limits_w);
    found.surplus_w = bev_minimum(bev_maximum(limits_w[0] - power_w, 0.0),
                                  bev_maximum(-inputs->propulsion_w[m], 0.0));
    found.lacking_w = bev_maximum(power_w - limits_w[1], 0.0);
    found.room_w = bev_minimum(bev_maximum(limits_w[1] - power_w, 0.0), limit_w);
  }
  return found;
}

/* The end of a stride [deg C] and what it takes [J] under a heater power [W]. */
static bev_status drive(const bev_vehicle *vehicle, const bev_stride_inputs *inputs, int32_t m,
                        double start_c, const margins *margin, double heater_w, double penalty,
                        double *end_c, double *energy_j) {
  const double brake_w = margin->surplus_w - bev_minimum(heater_w, margin->surplus_w);
  const double duration_s = inputs->duration_s[m];
  const double terminal_w = inputs->idle_power_w[m] + heater_w + brake_w;
  double result[4];
  bev_runge_kutta_4(
      vehicle, BEV_AS_ARRAYS, inputs->soc[m], start_c, duration_s, terminal_w,
      inputs->power_variance_w2[m],
      inputs->idle_heat_w[m] + vehicle->heater_efficiency * heater_w
          - vehicle->heat_share * brake_w,
      inputs->leakage_w_per_k[m], result);
  *end_c = result[1];
  *energy_j = duration_s * (terminal_w + result[3] + penalty * margin->lacking_w);
  return isfinite(*end_c) && isfinite(*energy_j) ? BEV_OK : BEV_NOT_FINITE;
}

static int are_inputs(const bev_stride_inputs *inputs) {
  return inputs->strides >= 0 && inputs->strides <= BEV_MOST_STEPS && inputs->duration_s != NULL
      && inputs->idle_power_w != NULL && inputs->power_variance_w2 != NULL
      && inputs->idle_heat_w != NULL && inputs->leakage_w_per_k != NULL
      && inputs->heater_limit_w != NULL && inputs->propulsion_w != NULL && inputs->soc != NULL
      && inputs->is_limited != NULL;
}

bev_status bev_map_strides(const bev_vehicle *vehicle, const bev_stride_inputs *inputs,
                           int32_t count, const double *grid_c, double penalty, double *maps,
                           double *needed_c) {
  if (vehicle == NULL || inputs == NULL || grid_c == NULL || maps == NULL || needed_c == NULL
      || count < 2 || count > BEV_MOST_AXIS || !are_inputs(inputs)) {
    return BEV_BAD_ARGUMENT;
  }
  if (!bev_is_vehicle(vehicle)) {
    return BEV_BAD_VEHICLE;
  }
  const size_t size = (size_t)inputs->strides * (size_t)count;
  double *const unheated_end_c = maps;
  double *const unheated_j = &maps[size];
  double *const heated_end_c = &maps[2 * size];
  double *const heated_j = &maps[3 * size];
  for (int32_t m = 0; m < inputs->strides; m++) {
    const double limit_w = inputs->heater_limit_w[m];
    double before_w = 0.0;
    needed_c[m] = -INFINITY;
    for (int32_t n = 0; n < count; n++) {
      const size_t at = (size_t)m * (size_t)count + (size_t)n;
      const margins margin = margins_of(vehicle, inputs, m, grid_c[n]);
      const double free_w = bev_minimum(limit_w, margin.surplus_w);
      bev_status status = drive(vehicle, inputs, m, grid_c[n], &margin, free_w, penalty,
                                &unheated_end_c[at], &unheated_j[at]);
      if (status == BEV_OK) {
        status = drive(vehicle, inputs, m, grid_c[n], &margin,
                       bev_maximum(margin.room_w, free_w), penalty, &heated_end_c[at],
                       &heated_j[at]);
      }
      if (status != BEV_OK) {
        return status;
      }
      /* Of the temperatures at which something is lacking the last one counts. */
      if (margin.lacking_w > 0.0) {
        const int32_t before = n > 0 ? n - 1 : 0;
        const double fallen_w = (n > 0 ? before_w : margin.lacking_w) - margin.lacking_w;
        const double slope =
            fallen_w / bev_maximum(grid_c[n] - grid_c[before], LEAST_WIDTH_K);
        needed_c[m] = grid_c[n] + (slope > 0.0 ? margin.lacking_w / slope : 0.0);
      }
      before_w = margin.lacking_w;
    }
  }
  return BEV_OK;
}
