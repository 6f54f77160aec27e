/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The simulated vehicle of bev_preheat.simulation in C99, which the planner does not need. Memory, loops, numbers
 * and statuses are as core.h has them.
 */
#ifndef BEV_PREHEAT_CORE_PLANT_H_
#define BEV_PREHEAT_CORE_PLANT_H_

#include "bev_preheat_core/core.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Most steps within a segment. */
#define BEV_MOST_PLANT_STEPS 1000000

/* A vehicle on its way; see bev_preheat.simulation.vehicle_plant. */
typedef struct {
  double time_s;
  double soc;
  double temperature_c;
  double sensor_c;
  double coolant_c;
  /* What heater and friction brake take now, what the heater was told, and its power at the end of the step [W]. */
  double heater_power_w;
  double brake_power_w;
  double command_w;
  double power_at_end_w;
  /* What the battery's terminals show now; a vehicle that stands draws nothing. */
  double voltage_v;
  double current_a;
  /* What has been since the start [J]. */
  double joule_j;
  double drivetrain_j;
  double heater_j;
  double leakage_j;
  double battery_j;
  double brake_j;
  /* The step of the trip in which the vehicle is; that behind the last has arrived. */
  int32_t segment;
} bev_plant;

/*
 * Drive on until an instant [s] or the end of the trip under a heater power [W], as far as limits allow it.
 *
 * The sensor is `sensor_lag_s` late, no step is longer than `longest_step_s`. Ends where the segment begins (or the
 * call began in it) in which the battery lacks power, runs empty or yields no number: BEV_SATURATED. `plant` is
 * where the vehicle is then; below BEV_OK it is left as it was.
 */
bev_status bev_drive_plant(const bev_vehicle *vehicle, const bev_trip *trip, double sensor_lag_s,
                           double longest_step_s, double until_s, double heater_power_w,
                           bev_plant *plant);

#ifdef __cplusplus
}
#endif

#endif /* BEV_PREHEAT_CORE_PLANT_H_ */
