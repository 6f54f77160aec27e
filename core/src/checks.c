/* SPDX-License-Identifier: Apache-2.0 */
#include "checks.h"

int32_t bev_interface(void) { return BEV_INTERFACE; }

int32_t bev_size_of_vehicle(void) { return (int32_t)sizeof(bev_vehicle); }

int32_t bev_size_of_trip(void) { return (int32_t)sizeof(bev_trip); }

int32_t bev_size_of_heating(void) { return (int32_t)sizeof(bev_heating); }

int32_t bev_size_of_strides(void) { return (int32_t)sizeof(bev_strides); }

int32_t bev_size_of_curve_range(void) { return (int32_t)sizeof(bev_curve_range); }

int32_t bev_size_of_settling(void) { return (int32_t)sizeof(bev_settling); }

int32_t bev_size_of_stranding(void) { return (int32_t)sizeof(bev_stranding); }

int32_t bev_size_of_run_of_powers(void) { return (int32_t)sizeof(bev_run_of_powers); }

int32_t bev_size_of_caution(void) { return (int32_t)sizeof(bev_caution); }

int32_t bev_size_of_switch_plan(void) { return (int32_t)sizeof(bev_switch_plan); }

int32_t bev_size_of_stretch(void) { return (int32_t)sizeof(bev_stretch); }

int32_t bev_size_of_merit_plan(void) { return (int32_t)sizeof(bev_merit_plan); }

int32_t bev_size_of_safe_goal(void) { return (int32_t)sizeof(bev_safe_goal); }

int32_t bev_size_of_safe_plan(void) { return (int32_t)sizeof(bev_safe_plan); }

int32_t bev_size_of_trip_terms(void) { return (int32_t)sizeof(bev_trip_terms); }

int32_t bev_size_of_arrival(void) { return (int32_t)sizeof(bev_arrival); }

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
