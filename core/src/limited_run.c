/* SPDX-License-Identifier: Apache-2.0 */
/* The forward run that keeps the battery's limits: bev_preheat.planning.limits. */
#include "heating.h"
#include "steps_of_model.h"

/* One step on its way: where it starts, what drives it. */
typedef struct {
  const bev_vehicle *vehicle;
  bev_inputs idle;
  double soc;
  double temperature_c;
} step_start;

/* Charge and temperature at the end of a step under heater and brake powers [W]. */
static bev_status end_of(const step_start *start, double heater_w, double brake_w, double result[4]) {
  const bev_vehicle *vehicle = start->vehicle;
  bev_inputs inputs = start->idle;
  inputs.power_w = start->idle.power_w + heater_w + brake_w;
  inputs.heat_w = start->idle.heat_w + vehicle->heater_efficiency * heater_w
      - vehicle->heat_share * brake_w;
  bev_integrate(vehicle, BEV_RUNGE_KUTTA_4, 1, start->soc, start->temperature_c, &inputs, result);
  return bev_kind_of(result[0], result[1]) == BEV_OK ? BEV_OK : BEV_NOT_FINITE;
}

/* The step in which the brake takes what would overfill the battery. */
static bev_status keep_from_overfilling(const step_start *start, double most_w, double heater_w,
                                        double *brake_w, double result[4]) {
  double enough_w = most_w;
  double too_little_w = *brake_w;
  for (int32_t n = 0; n < BEV_HALVINGS; n++) {
    const double middle_w = 0.5 * (enough_w + too_little_w);
    const bev_status status = end_of(start, heater_w, middle_w, result);
    if (status != BEV_OK) {
      return status;
    }
    if (result[0] <= 1.0) {
      enough_w = middle_w;
    } else {
      too_little_w = middle_w;
    }
  }
  *brake_w = enough_w;
  const bev_status status = end_of(start, heater_w, enough_w, result);
  result[0] = bev_minimum(result[0], 1.0);
  return status;
}

/* Drive step k from a state: `result` is the end of the step. */
static bev_status drive(const step_start *start, const bev_trip *trip, const bev_heating *heating,
                        int32_t k, double *heater_w, double *brake_w, double result[4]) {
  const bev_vehicle *vehicle = start->vehicle;
  const double power_w = start->idle.power_w;
  const double propulsion_w = trip->propulsion_power_w[k];
  const double highest_c = vehicle->highest_c;
  const double joules_per_k = vehicle->heat_capacity_j_per_k / vehicle->heater_efficiency;
  const int may_overcharge = heating->may_overcharge[k] != 0;
  double cap_w = trip->heater_limit_w[k];
  double heat_w = 0.0;
  double least_w = 0.0;
  if (start->temperature_c >= highest_c) {
    cap_w = 0.0;
  } else {
    heat_w = bev_wanted_w(heating, k, start->temperature_c);
  }
  if (may_overcharge || heating->may_overdraw[k] != 0) {
    double limits_w[2];
    bev_terminal_limits(vehicle, 0, start->soc, start->temperature_c, start->idle.variance_w2,
                        limits_w);
    if (!isfinite(limits_w[0]) || !isfinite(limits_w[1])) {
      return BEV_NOT_FINITE;
    }
    least_w = limits_w[0];
    heat_w = bev_maximum(0.0, bev_minimum(heat_w, limits_w[1] - power_w));
    if (may_overcharge && heating->takes_surplus != 0) {
      heat_w = bev_maximum(heat_w, bev_minimum(cap_w, least_w - power_w));
    }
  }
  int is_settled = 0;
  double braked_w = 0.0;
  for (int32_t round = 0; round < BEV_MOST_ROUNDS && !is_settled; round++) {
    braked_w = 0.0;
    if (may_overcharge) {
      braked_w = bev_minimum(bev_maximum(0.0, least_w - power_w - heat_w), -propulsion_w);
    }
    const bev_status status = end_of(start, heat_w, braked_w, result);
    if (status != BEV_OK) {
      return status;
    }
    if (heat_w <= 0.0 || result[1] <= highest_c + BEV_HIGHEST_TOLERANCE_K) {
      is_settled = 1;
    } else {
      heat_w = bev_maximum(
          0.0, heat_w - (result[1] - highest_c) * joules_per_k / start->idle.duration_s);
    }
  }
  if (!is_settled) {
    return BEV_NOT_SETTLED;
  }
  bev_status status = BEV_OK;
  if (result[0] > 1.0) {
    status = keep_from_overfilling(start, bev_maximum(0.0, -propulsion_w), heat_w, &braked_w,
                                   result);
  }
  *heater_w = heat_w;
  *brake_w = braked_w;
  return status;
}

bev_status bev_run_within_limits(const bev_vehicle *vehicle, const bev_trip *trip,
                                 const bev_heating *heating, int32_t first, double *soc,
                                 double *temperature_c, double *heater_w, double *brake_w,
                                 int32_t *empty_step) {
  const bev_status checked = bev_checked(vehicle, trip, first);
  if (checked != BEV_OK) {
    return checked;
  }
  if (!bev_is_heating(heating) || soc == NULL || temperature_c == NULL || heater_w == NULL
      || brake_w == NULL || empty_step == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  if (!isfinite(soc[first]) || !isfinite(temperature_c[first])) {
    return BEV_BAD_INPUT;
  }
  double result[4] = {0.0, 0.0, 0.0, 0.0};
  for (int32_t k = first; k < trip->steps; k++) {
    const step_start start = {vehicle, bev_inputs_of(vehicle, trip, k, NULL, NULL), soc[k],
                              temperature_c[k]};
    if (!bev_are_finite(&start.idle) || !isfinite(trip->propulsion_power_w[k])
        || !isfinite(trip->heater_limit_w[k]) || !isfinite(heating->power_w[k])) {
      return BEV_BAD_INPUT;
    }
    const bev_status status = drive(&start, trip, heating, k, &heater_w[k], &brake_w[k], result);
    if (status != BEV_OK) {
      return status;
    }
    if (result[0] <= 0.0) {
      *empty_step = k;
      return BEV_EMPTY;
    }
    soc[k + 1] = result[0];
    temperature_c[k + 1] = bev_minimum(result[1], vehicle->hottest_c);
  }
  return BEV_OK;
}
