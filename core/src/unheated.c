/* SPDX-License-Identifier: Apache-2.0 */
/* What a trip lacks without paid heating: what bev_preheat.planning.no_regret holds a plan against. */
#include "checks.h"
#include "courses.h"
#include "limited_step.h"

bev_status bev_unheated_lacks(const bev_vehicle *vehicle, const bev_trip *trip,
                              const double *start, double *memory, uint8_t *flags,
                              double *lacking_w, bev_stranding *stranding) {
  const bev_status checked = bev_checked(vehicle, trip, 0);
  if (checked != BEV_OK) {
    return checked;
  }
  if (start == NULL || memory == NULL || flags == NULL || lacking_w == NULL || stranding == NULL
      || trip->steps < 1) {
    return BEV_BAD_ARGUMENT;
  }
  const int32_t steps = trip->steps;
  const int32_t rows = bev_is_direct(vehicle) ? 2 : 4;
  double *const command_w = bev_take(&memory, steps);
  double *const states = bev_take(&memory, rows * (steps + 1));
  double *const powers_w = bev_take(&memory, rows * steps);
  bev_course course = {rows, {NULL, NULL, NULL, NULL}, {NULL, NULL, NULL, NULL}, {-1, 1.0}};
  for (int32_t n = 0; n < rows; n++) {
    course.states[n] = &states[n * (steps + 1)];
    course.powers_w[n] = &powers_w[n * steps];
    course.states[n][0] = start[n];
  }
  for (int32_t k = 0; k < steps; k++) {
    command_w[k] = 0.0;
  }
  bev_status status = bev_drive_as_planned(vehicle, trip, command_w, states, powers_w, flags,
                                           &course.stranding);
  if (status == BEV_OK) {
    *stranding = course.stranding;
    status = bev_lacking_w(vehicle, trip, &course, lacking_w);
  }
  return status;
}
