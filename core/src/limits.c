/* SPDX-License-Identifier: Apache-2.0 */
/* The battery's limits along a run: limits_of_steps_w of bev_preheat.planning.dynamics. */
#include <stdbool.h>

#include "checks.h"
#include "curve_arrays.h"
#include "steps_of_model.h"

/*
 * As bev_limits_of_steps, for up to BEV_BLOCK steps: the curves' values at the end of a step serve for the start
 * of the next step.
 */
static bev_status limits_of_block(const bev_vehicle *vehicle, int32_t steps, const double *soc,
                                  const double *temperature_c, const double *variance_w2, double *least_w,
                                  double *most_w) {
  double voltage_v[BEV_BLOCK + 1];
  double resistance_ohm[BEV_BLOCK + 1];
  double charge_w[BEV_BLOCK + 1];
  double discharge_w[BEV_BLOCK + 1];
  const int32_t instants = steps + 1;
  bev_curve_over(&vehicle->open_circuit_voltage, instants, soc, temperature_c, voltage_v);
  bev_curve_over(&vehicle->resistance, instants, soc, temperature_c, resistance_ohm);
  bev_curve_over(&vehicle->charge_power_limit, instants, soc, temperature_c, charge_w);
  bev_curve_over(&vehicle->discharge_power_limit, instants, soc, temperature_c, discharge_w);
  bool are_numbers = true;
  for (int32_t n = 0; n < steps; n++) {
    double start_w[2];
    double end_w[2];
    bev_terminal_limits_of_circuit(vehicle, BEV_AS_ARRAYS, voltage_v[n], resistance_ohm[n],
                                   charge_w[n], discharge_w[n], variance_w2[n], start_w);
    bev_terminal_limits_of_circuit(vehicle, BEV_AS_ARRAYS, voltage_v[n + 1],
                                   resistance_ohm[n + 1], charge_w[n + 1], discharge_w[n + 1],
                                   variance_w2[n], end_w);
    least_w[n] = bev_maximum(start_w[0], end_w[0]);
    most_w[n] = bev_minimum(start_w[1], end_w[1]);
    are_numbers = are_numbers && isfinite(start_w[0]) != 0 && isfinite(start_w[1]) != 0
        && isfinite(end_w[0]) != 0 && isfinite(end_w[1]) != 0;
  }
  return are_numbers ? BEV_OK : BEV_NOT_FINITE;
}

bev_status bev_limits_of_steps(const bev_vehicle *vehicle, int32_t steps, const double *soc,
                               const double *temperature_c, const double *variance_w2, double *least_w,
                               double *most_w) {
  if (vehicle == NULL || soc == NULL || temperature_c == NULL || variance_w2 == NULL
      || least_w == NULL || most_w == NULL || steps < 0 || steps > BEV_MOST_STEPS) {
    return BEV_BAD_ARGUMENT;
  }
  if (!bev_is_vehicle(vehicle)) {
    return BEV_BAD_VEHICLE;
  }
  bev_status status = BEV_OK;
  for (int32_t from = 0; from < steps && status == BEV_OK; from += BEV_BLOCK) {
    const int32_t count = steps - from < BEV_BLOCK ? steps - from : BEV_BLOCK;
    status = limits_of_block(vehicle, count, &soc[from], &temperature_c[from],
                                 &variance_w2[from], &least_w[from], &most_w[from]);
  }
  return status;
}
