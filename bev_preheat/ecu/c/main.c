/* SPDX-License-Identifier: Apache-2.0 */
/* Plans one situation, that of example.c, and prints the plan. */
#include <math.h>
#include <stdio.h>

#include "vehicle.h"

/* All memory of the planner: a control unit reserves it once. */
static double memory[BEV_ECU_MEMORY(BEV_MOST_STEPS)];

int main(void) {
  bev_ecu_plan plan;
  const bev_status status = bev_ecu_plan_switch(&bev_ecu_vehicle, &bev_ecu_example_trip,
                                                &bev_ecu_example, memory, &plan);
  const double arrival_s = bev_ecu_example_trip.time_s[bev_ecu_example_trip.steps];
  printf("vehicle %s: %.1f min, from %.1f degC, target %.1f degC\n", bev_ecu_vehicle_name,
         arrival_s / 60.0, bev_ecu_example.temperature_c, bev_ecu_example.target_c);
  if (status != BEV_OK) {
    printf("no plan: status %d\n", (int)status);
    return 1;
  }
  if (isnan(plan.on_s)) {
    printf("no heating\n");
  } else {
    printf("heater on at %.3f s, off at %.3f s: %.3f Wh\n", plan.on_s,
           isnan(plan.off_s) ? arrival_s : plan.off_s, plan.energy_wh.hvch_electric);
  }
  printf("arrival: %.3f degC, %.2f %% charged, %.3f Wh of the battery\n", plan.arrival_c,
         100.0 * plan.arrival_soc, plan.energy_wh.battery_total);
  return 0;
}
