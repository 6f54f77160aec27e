/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Back to back: plans each situation of a file (vectors.txt) with both methods and compares with the file's plans.
 *
 *     check FILE     exit status 0: all plans agree; 1: some differ; 2: the file cannot be read
 *
 * For each vector the file has the word "vector", steps, charge, battery temperature, heater power, coolant
 * excess, target, required charge on arrival and on the way; for optimal_switch, then for merit_order the
 * expected status, instants of switching on and off, six energies [Wh], temperature and charge on arrival; then
 * the columns of the trip in the order of bev_trip. The file ends with the word "end" and the number of vectors.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "vehicle.h"

#define INSTANT_TOLERANCE_S 1e-3
#define ENERGY_TOLERANCE_WH 1e-3
#define ARRIVAL_TOLERANCE_K 1e-4
#define ARRIVAL_TOLERANCE_SOC 1e-7
#define COLUMNS 10
#define SITUATION_NUMBERS 7
#define EXPECTED_NUMBERS 10
#define MOST_TOLD 10

enum { SWITCH, MERIT_ORDER, METHODS };
static const char *const methods[METHODS] = {"optimal_switch", "merit_order"};

/* Merit order takes more. */
static double columns[COLUMNS][BEV_MOST_STEPS + 1];
static double memory[BEV_ECU_MERIT_MEMORY(BEV_MOST_STEPS)];
static uint8_t flags[BEV_ECU_MERIT_FLAGS(BEV_MOST_STEPS)];
static int32_t order[BEV_MOST_STEPS];

typedef struct {
  int32_t steps;
  double situation[SITUATION_NUMBERS];
  int32_t status[METHODS];
  double expected[METHODS][EXPECTED_NUMBERS];
} vector;

static const char *const names[EXPECTED_NUMBERS] = {
    "on [s]", "off [s]", "Joule heat [Wh]", "drivetrain heat [Wh]", "heat of the heater [Wh]",
    "leakage [Wh]", "heater [Wh]", "battery [Wh]", "arrival [degC]", "arrival [charge]"};
static const double tolerances[EXPECTED_NUMBERS] = {
    INSTANT_TOLERANCE_S, INSTANT_TOLERANCE_S, ENERGY_TOLERANCE_WH, ENERGY_TOLERANCE_WH,
    ENERGY_TOLERANCE_WH, ENERGY_TOLERANCE_WH, ENERGY_TOLERANCE_WH, ENERGY_TOLERANCE_WH,
    ARRIVAL_TOLERANCE_K, ARRIVAL_TOLERANCE_SOC};

/* Read a number, also "nan" and "inf", independently of the library's scanf; return 0 if it is not a number. */
static int read_number(FILE *file, double *number) {
  char word[64];
  char *end = word;
  if (fscanf(file, "%63s", word) != 1) {
    return 0;
  }
  if (strcmp(word, "nan") == 0) {
    *number = NAN;
    return 1;
  }
  if (strcmp(word, "inf") == 0 || strcmp(word, "-inf") == 0) {
    *number = word[0] == '-' ? -INFINITY : INFINITY;
    return 1;
  }
  *number = strtod(word, &end);
  return end != word && *end == '\0';
}

static int read_numbers(FILE *file, double *numbers, int32_t count) {
  for (int32_t n = 0; n < count; n++) {
    if (!read_number(file, &numbers[n])) {
      return 0;
    }
  }
  return 1;
}

/* Read the expected answer of one method. */
static int read_answer(FILE *file, vector *read, int method) {
  double status = 0.0;
  if (!read_number(file, &status) || !(fabs(status) < 100.0)
      || !read_numbers(file, read->expected[method], EXPECTED_NUMBERS)) {
    return 0;
  }
  read->status[method] = (int32_t)status;
  return 1;
}

/* Read the text after the word "vector". */
static int read_vector(FILE *file, vector *read) {
  double steps = 0.0;
  if (!read_number(file, &steps) || !(steps >= 1.0)) {
    return 0;
  }
  if (steps > (double)BEV_MOST_STEPS) {
    printf("a trip of %.0f steps, but compiled for %ld (BEV_MOST_STEPS)\n", steps,
           (long)BEV_MOST_STEPS);
    return 0;
  }
  if (!read_numbers(file, read->situation, SITUATION_NUMBERS) || !read_answer(file, read, SWITCH)
      || !read_answer(file, read, MERIT_ORDER)) {
    return 0;
  }
  read->steps = (int32_t)steps;
  for (int32_t n = 0; n < COLUMNS; n++) {
    if (!read_numbers(file, columns[n], n == 0 ? read->steps + 1 : read->steps)) {
      return 0;
    }
  }
  return 1;
}

/* Number of differing values of a plan; records the greatest difference of each kind. */
static int compare(const vector *from, int method, const bev_ecu_plan *plan, long number,
                   int is_told, double worst[EXPECTED_NUMBERS]) {
  const double found[EXPECTED_NUMBERS] = {
      plan->on_s, plan->off_s, plan->energy_wh.joule, plan->energy_wh.drivetrain_heat,
      plan->energy_wh.hvch_heat, plan->energy_wh.leakage, plan->energy_wh.hvch_electric,
      plan->energy_wh.battery_total, plan->arrival_c, plan->arrival_soc};
  int wrong = 0;
  for (int n = 0; n < EXPECTED_NUMBERS; n++) {
    const double expected = from->expected[method][n];
    const double difference = fabs(found[n] - expected);
    if (isnan(found[n]) && isnan(expected)) {
      continue;
    }
    if (!(difference <= tolerances[n])) {
      wrong++;
      if (is_told) {
        printf("vector %ld, %s: %s is %.17g, expected %.17g\n", number, methods[method], names[n],
               found[n], expected);
      }
    }
    if (difference > worst[n]) {
      worst[n] = difference;
    }
  }
  return wrong;
}

static int is_as_expected(const vector *from, int method, long number, int is_told,
                          double worst[EXPECTED_NUMBERS]) {
  const bev_trip trip = {from->steps, columns[0], columns[1], columns[2], columns[3], columns[4],
                         columns[5],  columns[6], columns[7], columns[8], columns[9],
                         NULL};
  const double *of = from->situation;
  const bev_ecu_situation situation = {of[0], of[1], of[2], of[3], of[4], of[5], of[6]};
  bev_ecu_plan plan;
  const bev_status status = method == SWITCH
      ? bev_ecu_plan_switch(&bev_ecu_vehicle, &trip, &situation, memory, &plan)
      : bev_ecu_plan_merit_order(&bev_ecu_vehicle, &trip, &situation, memory, flags, order,
                                 &plan);
  if ((int32_t)status != from->status[method]) {
    if (is_told) {
      printf("vector %ld, %s: status is %d, expected %d\n", number, methods[method], (int)status,
             (int)from->status[method]);
    }
    return 0;
  }
  return status != BEV_OK || compare(from, method, &plan, number, is_told, worst) == 0;
}

int main(int count, char **arguments) {
  double worst[EXPECTED_NUMBERS] = {0.0};
  long vectors = 0;
  long planned[METHODS] = {0};
  long wrong = 0;
  char word[16];
  vector read;
  FILE *file = count == 2 ? fopen(arguments[1], "r") : NULL;
  if (file == NULL) {
    printf("usage: check FILE, a file of vectors that can be read\n");
    return 2;
  }
  while (fscanf(file, "%15s", word) == 1 && strcmp(word, "vector") == 0) {
    if (!read_vector(file, &read)) {
      printf("vector %ld: cannot be read\n", vectors + 1);
      fclose(file);
      return 2;
    }
    vectors++;
    int is_right = 1;
    for (int method = 0; method < METHODS; method++) {
      planned[method] += read.status[method] == BEV_OK;
      is_right &= is_as_expected(&read, method, vectors, wrong < MOST_TOLD, worst);
    }
    wrong += !is_right;
  }
  double announced = -1.0;
  const int is_whole = strcmp(word, "end") == 0 && read_number(file, &announced)
      && announced == (double)vectors;
  fclose(file);
  if (!is_whole || vectors == 0) {
    printf("%s: not whole after %ld vectors\n", arguments[1], vectors);
    return 2;
  }
  const double instant_s = fmax(worst[0], worst[1]);
  double energy_wh = 0.0;
  for (int n = 2; n < 8; n++) {
    energy_wh = fmax(energy_wh, worst[n]);
  }
  printf("%ld vectors, %ld with a plan of %s, %ld of %s: %ld differ; most: %.2e ms, %.2e mWh, %.2e K\n",
         vectors, planned[SWITCH], methods[SWITCH], planned[MERIT_ORDER], methods[MERIT_ORDER], wrong,
         1e3 * instant_s, 1e3 * energy_wh, worst[8]);
  return wrong == 0 ? 0 : 1;
}
