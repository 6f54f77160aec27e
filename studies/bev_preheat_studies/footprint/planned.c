/* SPDX-License-Identifier: Apache-2.0 */
#include "planned.h"

#include "vehicle.h"

/* Static, so that the stack holds hardly more than the plan's own frames. */
static bev_trip trip;
static bev_ecu_situation situation;
static bev_ecu_plan plan;
static double memory[BEV_ECU_VALUE_MEMORY(BEV_MOST_STEPS)];
static uint8_t flags[BEV_ECU_VALUE_BYTES(BEV_MOST_STEPS)];

void take_situation(int32_t steps, const double *numbers) {
  const double *const time_s = &numbers[SITUATION_NUMBERS];
  const double *const after = &time_s[steps + 1];
  const bev_trip taken = {steps,
                          time_s,
                          after,
                          &after[steps],
                          &after[2 * steps],
                          &after[3 * steps],
                          &after[4 * steps],
                          &after[5 * steps],
                          &after[6 * steps],
                          &after[7 * steps],
                          &after[8 * steps]};
  const bev_ecu_situation of = {numbers[0], numbers[1], numbers[2], numbers[3],
                                numbers[4], numbers[5], numbers[6]};
  trip = taken;
  situation = of;
}

int32_t plan_switch(void) {
  return (int32_t)bev_ecu_plan_switch(&bev_ecu_vehicle, &trip, &situation, memory, &plan);
}

int32_t plan_by_values(void) {
  return (int32_t)bev_ecu_plan_by_values(&bev_ecu_vehicle, &trip, &situation, memory, flags, &plan);
}

void tell_plan(double *answer) {
  const double told[ANSWER_NUMBERS] = {
      plan.on_s, plan.off_s, plan.energy_wh.joule, plan.energy_wh.drivetrain_heat,
      plan.energy_wh.hvch_heat, plan.energy_wh.leakage, plan.energy_wh.hvch_electric,
      plan.energy_wh.battery_total, plan.arrival_c, plan.arrival_soc};
  for (int n = 0; n < ANSWER_NUMBERS; n++) {
    answer[n] = told[n];
  }
}

int64_t switch_bytes(int32_t steps, int32_t has_heat_path) {
  const int64_t doubles = has_heat_path ? BEV_ECU_MEMORY(steps) : BEV_ECU_DIRECT_MEMORY(steps);
  return doubles * (int64_t)sizeof(double);
}

int64_t values_bytes(int32_t steps) {
  return BEV_ECU_VALUE_MEMORY(steps) * (int64_t)sizeof(double)
      + BEV_ECU_VALUE_BYTES(steps) * (int64_t)sizeof(uint8_t);
}
