/* SPDX-License-Identifier: Apache-2.0 */
#include "checks.h"

static int is_axis(const double *axis, int32_t count) {
  for (int32_t n = 0; n < count; n++) {
    if (!isfinite(axis[n]) || (n > 0 && !(axis[n] > axis[n - 1]))) {
      return 0;
    }
  }
  return 1;
}

static int is_curve_of_numbers(const bev_curve *curve) {
  if (!bev_are_numbers(curve->factor, curve->factor_count)) {
    return 0;
  }
  if (curve->kind != (int32_t)BEV_TABLE) {
    return bev_are_numbers(curve->parameter, BEV_CURVE_PARAMETERS);
  }
  return is_axis(curve->soc, curve->soc_count)
      && is_axis(curve->temperature_c, curve->temperature_count)
      && bev_are_numbers(curve->values, curve->soc_count * curve->temperature_count);
}

bev_status bev_check_vehicle(const bev_vehicle *vehicle) {
  if (vehicle == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  if (!bev_is_vehicle(vehicle) || !is_curve_of_numbers(&vehicle->open_circuit_voltage)
      || !is_curve_of_numbers(&vehicle->resistance)
      || !is_curve_of_numbers(&vehicle->charge_power_limit)
      || !is_curve_of_numbers(&vehicle->discharge_power_limit)) {
    return BEV_BAD_VEHICLE;
  }
  return BEV_OK;
}
