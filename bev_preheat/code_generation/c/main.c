/* SPDX-License-Identifier: Apache-2.0 */
/* Plans one situation, that of example.c, with both methods, and prints the plans. */
#include <math.h>
#include <stdio.h>

#include "vehicle.h"

/* All memory of the planner: a control unit reserves it once, for optimal_switch alone BEV_ECU_MEMORY. */
static double memory[BEV_ECU_VALUE_MEMORY(BEV_MOST_STEPS)];
static uint8_t flags[BEV_ECU_VALUE_BYTES(BEV_MOST_STEPS)];

static int tell(const char *method, bev_status status, const bev_ecu_plan *plan) {
  const double arrival_s = bev_ecu_example_trip.time_s[bev_ecu_example_trip.steps];
  if (status != BEV_OK) {
    printf("%s: no plan: status %d\n", method, (int)status);
    return 1;
  }
  if (isnan(plan->on_s)) {
    printf("%s: no heating\n", method);
  } else {
    printf("%s: heater on at %.3f s, off at %.3f s: %.3f Wh\n", method, plan->on_s,
           isnan(plan->off_s) ? arrival_s : plan->off_s, plan->energy_wh.hvch_electric);
  }
  printf("arrival: %.3f degC, %.2f %% charged, %.3f Wh of the battery\n", plan->arrival_c,
         100.0 * plan->arrival_soc, plan->energy_wh.battery_total);
  return 0;
}

int main(void) {
  bev_ecu_plan plan;
  printf("vehicle %s: %.1f min, from %.1f degC, target %.1f degC\n", bev_ecu_vehicle_name,
         bev_ecu_example_trip.time_s[bev_ecu_example_trip.steps] / 60.0,
         bev_ecu_example.temperature_c, bev_ecu_example.target_c);
  bev_status status = bev_ecu_plan_switch(&bev_ecu_vehicle, &bev_ecu_example_trip,
                                          &bev_ecu_example, memory, &plan);
  int failures = tell("optimal_switch", status, &plan);
  status = bev_ecu_plan_by_values(&bev_ecu_vehicle, &bev_ecu_example_trip, &bev_ecu_example,
                                  memory, flags, &plan);
  failures += tell("value_function", status, &plan);
  return failures == 0 ? 0 : 1;
}
