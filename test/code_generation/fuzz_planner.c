/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Plans with random numbers in vehicle, trip and situation, some of them NaN, infinite, huge or zero.
 *
 *     fuzz_planner METHOD COUNT SEED     METHOD: optimal_switch, value_function
 *
 * Exit status 0: each answer is a status, and a plan is made of possible numbers.
 *
 * Each array is allocated with its exact size, so that a sanitizer sees what is read or written beyond it.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "vehicle.h"

#define COLUMNS 10
#define MOST_STEPS_DRAWN 12
#define STATUSES 10

/* Of xorshift64*, George Marsaglia's. */
static uint64_t state = 88172645463325252u;

static uint64_t draw(void) {
  state ^= state >> 12;
  state ^= state << 25;
  state ^= state >> 27;
  return state * 2685821657736338717u;
}

static int32_t draw_below(int32_t count) { return (int32_t)((draw() >> 33) % (uint64_t)count); }

static double uniform(double low, double high) {
  return low + (high - low) * ((double)(draw() >> 11) / 9007199254740992.0);
}

/* A number that no vehicle and no trip has, or any pattern of bits. */
static double odd_number(void) {
  static const double odd[] = {NAN, INFINITY, -INFINITY, 0.0, -0.0, 1.7e308, -1.7e308, 4.9e-324, 1e-300, -1.0};
  const int32_t which = draw_below(12);
  if (which < 10) {
    return odd[which];
  }
  if (which == 10) {
    return uniform(-1e9, 1e9);
  }
  const uint64_t bits = draw();
  double number;
  memcpy(&number, &bits, sizeof number);
  return number;
}

/* The share of numbers that are odd, in this case. */
static double odd_share;
static int is_by_values;

static double mostly(double usual) { return uniform(0.0, 1.0) < odd_share ? odd_number() : usual; }

static void change_vehicle(bev_vehicle *vehicle) {
  if (draw_below(2) == 0) {
    vehicle->heater_lag_s = mostly(45.0);
    vehicle->coolant_heat_capacity_j_per_k = mostly(16e3);
    vehicle->coolant_conductance_w_per_k = mostly(280.0);
  }
  if (odd_share == 0.0 || draw_below(4) != 0) {
    return;
  }
  bev_curve *const curves[4] = {&vehicle->open_circuit_voltage, &vehicle->resistance,
                                &vehicle->charge_power_limit, &vehicle->discharge_power_limit};
  bev_curve *curve = curves[draw_below(4)];
  switch (draw_below(8)) {
    case 0: vehicle->capacity_ah = odd_number(); break;
    case 1: vehicle->heat_capacity_j_per_k = odd_number(); break;
    case 2: vehicle->highest_c = odd_number(); break;
    case 3: vehicle->heater_efficiency = odd_number(); break;
    case 4: curve->parameter[draw_below(BEV_CURVE_PARAMETERS)] = odd_number(); break;
    case 5: curve->kind = draw_below(7) - 1; break;
    case 6:
      curve->factor_count = draw_below(BEV_MOST_FACTORS + 3) - 1;
      for (int32_t n = 0; n < BEV_MOST_FACTORS; n++) {
        curve->factor[n] = mostly(1.1);
      }
      break;
    default: curve->soc_count = draw_below(2) == 0 ? 0 : BEV_MOST_AXIS + 1; break;
  }
}

/* A power of the drivetrain [W]; on some trips beyond what a cold battery gives and takes. */
static double draw_power_w(int is_limited) {
  return is_limited ? uniform(-90e3, 160e3) : uniform(-500.0, 20e3);
}

static void fill_columns(double *const columns[COLUMNS], int32_t steps) {
  const int time_may_be_odd = draw_below(3) == 0;
  const int is_limited = is_by_values && draw_below(2) == 0;
  columns[0][0] = 0.0;
  for (int32_t k = 0; k < steps; k++) {
    columns[1][k] = uniform(20.0, 200.0);
    columns[0][k + 1] = columns[0][k] + columns[1][k];
    columns[7][k] = mostly(draw_power_w(is_limited && draw_below(3) == 0));
    columns[2][k] = mostly(columns[7][k] + 1500.0);
    columns[3][k] = mostly(uniform(0.0, 1e6));
    columns[5][k] = mostly(uniform(20.0, 60.0));
    columns[9][k] = mostly(uniform(-15.0, 5.0));
    columns[8][k] = mostly(0.03 * fabs(columns[7][k]));
    columns[4][k] = mostly(columns[5][k] * columns[9][k] + columns[8][k]);
    columns[6][k] = mostly(uniform(0.0, 5e3));
  }
  for (int32_t k = 0; k < steps && time_may_be_odd; k++) {
    columns[0][k + 1] = mostly(columns[0][k + 1]);
    columns[1][k] = mostly(columns[1][k]);
  }
}

/* Whether a plan has only numbers that it may have. */
static int is_possible(const bev_ecu_plan *plan, const bev_trip *trip) {
  const double numbers[] = {
      plan->arrival_c, plan->arrival_soc, plan->least_soc, plan->shortfall_k, plan->deficit_w,
      plan->energy_wh.joule, plan->energy_wh.drivetrain_heat, plan->energy_wh.hvch_heat,
      plan->energy_wh.leakage, plan->energy_wh.hvch_electric, plan->energy_wh.battery_total};
  for (size_t n = 0; n < sizeof numbers / sizeof *numbers; n++) {
    if (!isfinite(numbers[n])) {
      return 0;
    }
  }
  for (int32_t k = 0; k < trip->steps; k++) {
    if (!(plan->heater_w[k] >= 0.0 && plan->heater_w[k] <= trip->heater_limit_w[k])
        || !isfinite(plan->soc[k + 1]) || !isfinite(plan->temperature_c[k + 1])
        || (plan->brake_w != NULL && !(plan->brake_w[k] >= 0.0))) {
      return 0;
    }
  }
  return isnan(plan->on_s) || (plan->on_s >= 0.0 && plan->on_s <= trip->time_s[trip->steps]);
}

/* The status of one case, 99 where the answer is impossible. */
static int plan_one(void) {
  const int32_t steps = 1 + draw_below(MOST_STEPS_DRAWN);
  double *columns[COLUMNS];
  double *memory = malloc(
      sizeof(double) * (size_t)(is_by_values ? BEV_ECU_VALUE_MEMORY(steps) : BEV_ECU_MEMORY(steps)));
  uint8_t *flags = malloc((size_t)BEV_ECU_VALUE_BYTES(steps));
  for (int n = 0; n < COLUMNS; n++) {
    columns[n] = malloc(sizeof(double) * (size_t)(steps + (n == 0)));
    if (columns[n] == NULL || memory == NULL || flags == NULL) {
      return 99;
    }
  }
  bev_vehicle vehicle = bev_ecu_vehicle;
  change_vehicle(&vehicle);
  fill_columns(columns, steps);
  bev_trip trip = {steps,      columns[0], columns[1], columns[2], columns[3], columns[4],
                   columns[5], columns[6], columns[7], columns[8], columns[9], NULL};
  const bev_ecu_situation situation = {
      mostly(uniform(0.3, 0.9)), mostly(uniform(0.0, 10.0)), mostly(0.0), mostly(0.0),
      mostly(uniform(0.0, 20.0)), mostly(0.1), mostly(0.05)};
  if (draw_below(100) == 0) {
    trip.steps = draw_below(2) == 0 ? -steps : BEV_MOST_STEPS + 1;
  }
  bev_ecu_plan plan;
  const bev_status status = is_by_values
      ? bev_ecu_plan_by_values(&vehicle, &trip, &situation, memory, flags, &plan)
      : bev_ecu_plan_switch(&vehicle, &trip, &situation, memory, &plan);
  int answer = (int)status;
  if (status == BEV_OK ? !is_possible(&plan, &trip)
                       : status != BEV_LIMITED && (status > BEV_OK || status < BEV_NOT_SETTLED)) {
    answer = 99;
  }
  for (int n = 0; n < COLUMNS; n++) {
    free(columns[n]);
  }
  free(memory);
  free(flags);
  return answer;
}

int main(int count, char **arguments) {
  static const double shares[] = {0.0, 0.004, 0.03, 0.5};
  long answers[STATUSES] = {0};
  if (count != 4) {
    printf("usage: fuzz_planner METHOD COUNT SEED\n");
    return 2;
  }
  const long cases = strtol(arguments[2], NULL, 10);
  is_by_values = strcmp(arguments[1], "value_function") == 0;
  state ^= (uint64_t)strtol(arguments[3], NULL, 10) * 0x9E3779B97F4A7C15u;
  for (long n = 0; n < cases; n++) {
    odd_share = shares[n % 4];
    const int answer = plan_one();
    if (answer == 99) {
      printf("case %ld: impossible\n", n);
      return 1;
    }
    answers[answer + 5]++;
  }
  for (int n = 0; n < STATUSES; n++) {
    printf("status %d: %ld\n", n - 5, answers[n]);
  }
  return 0;
}
