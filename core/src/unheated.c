/* SPDX-License-Identifier: Apache-2.0 */
/* Power deficit of a trip without paid heating, with which bev_preheat.planning.no_regret compares a plan. */
#include "checks.h"
#include "trajectory.h"
#include "limited_step.h"

bev_status bev_unheated_deficit(const bev_vehicle *vehicle, const bev_trip *trip,
                              const double *start, double *memory, uint8_t *flags,
                              double *deficit_w, bev_stranding *stranding) {
  const bev_status checked = bev_checked(vehicle, trip, 0);
  if (checked != BEV_OK) {
    return checked;
  }
  if (start == NULL || memory == NULL || flags == NULL || deficit_w == NULL || stranding == NULL
      || trip->steps < 1) {
    return BEV_BAD_ARGUMENT;
  }
  const int32_t steps = trip->steps;
  const int32_t rows = bev_is_direct(vehicle) ? 2 : 4;
  double *const command_w = bev_take(&memory, steps);
  double *const states = bev_take(&memory, rows * (steps + 1));
  double *const powers_w = bev_take(&memory, rows * steps);
  bev_trajectory trajectory = {rows, {NULL, NULL, NULL, NULL}, {NULL, NULL, NULL, NULL}, {-1, 1.0}};
  for (int32_t n = 0; n < rows; n++) {
    trajectory.states[n] = &states[n * (steps + 1)];
    trajectory.powers_w[n] = &powers_w[n * steps];
    trajectory.states[n][0] = start[n];
  }
  for (int32_t k = 0; k < steps; k++) {
    command_w[k] = 0.0;
  }
  bev_status status = bev_drive_as_planned(vehicle, trip, command_w, states, powers_w, flags,
                                           &trajectory.stranding);
  if (status == BEV_OK) {
    *stranding = trajectory.stranding;
    status = bev_deficit_w(vehicle, trip, &trajectory, deficit_w);
  }
  return status;
}
