/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Many trips of one vehicle, each without heating, always heated, and planned by two methods, as
 * bev_preheat_studies.fleet.ways does for one trip without active limits.
 */
#include "bev_preheat_core_generated/constants.h"
#include "checks.h"
#include "limits_of_run.h"
#include "paper.h"
#include "parts_of_plans.h"
#include "step_limits.h"
#include "steps_of_model.h"

/* Arrays of a trip in the memory, the first ones those of bev_plan_switch. */
#define SWITCH_ROOMS 8
#define ROOMS 12

/* One trip, its requirements, and the memory that its ways share. */
typedef struct {
  const bev_vehicle *vehicle;
  bev_trip trip;
  double target_c;
  double reserve_soc;
  double lowest_soc;
  const double *idle_soc;
  const double *idle_c;
  /* Of SWITCH_ROOMS, the arrays behind the unheated run are free once the plan is made. */
  double *room[ROOMS];
  uint8_t *may_overcharge;
  uint8_t *may_overdraw;
} drive;

static void arrive(bev_arrival *arrival, bev_status status, double heater_wh, double temperature_c,
                   double soc, double instant_s) {
  arrival->status = (int32_t)status;
  arrival->heater_wh = heater_wh;
  arrival->temperature_c = temperature_c;
  arrival->soc = soc;
  arrival->instant_s = instant_s;
}

/* Heater energy [Wh]. */
static double taken_wh(const bev_trip *trip, const double *heater_w) {
  double sum = 0.0;
  for (int32_t k = 0; k < trip->steps; k++) {
    sum += trip->duration_s[k] / BEV_JOULES_PER_WH * heater_w[k];
  }
  return sum;
}

/* Whether a run leaves the required charge, on arrival and on the way. */
static int leaves_enough(const drive *of, const double *soc) {
  for (int32_t k = 0; k <= of->trip.steps; k++) {
    if (!(soc[k] >= of->lowest_soc)) {
      return 0;
    }
  }
  return soc[of->trip.steps] >= of->reserve_soc;
}

/* The steps in which a limit is near: bev_preheat.planning.limits.limit_is_near, step by step. */
static bev_status watch_limits(const drive *of) {
  const bev_trip *trip = &of->trip;
  bev_status status = BEV_OK;
  for (int32_t k = 0; k < trip->steps && status == BEV_OK; k++) {
    double limits_w[2];
    status = bev_limits_of_colder_step(of->vehicle, &of->idle_soc[k], &of->idle_c[k],
                                       trip->power_variance_w2[k], limits_w);
    of->may_overcharge[k] =
        trip->propulsion_power_w[k] < 0.0 && trip->idle_power_w[k] < limits_w[0];
    of->may_overdraw[k] = trip->idle_power_w[k] + trip->heater_limit_w[k] > limits_w[1];
  }
  return status;
}

/* Heated from the start, up to the target. */
static void always_on(const drive *of, bev_arrival *arrival) {
  const bev_trip *trip = &of->trip;
  const int32_t steps = trip->steps;
  bev_status status = watch_limits(of);
  if (status != BEV_OK) {
    arrive(arrival, status, NAN, NAN, NAN, NAN);
    return;
  }
  const bev_heating heating = {0, of->target_c, trip->heater_limit_w, of->may_overcharge,
                               of->may_overdraw};
  double *soc = of->room[4];
  double *temperature_c = of->room[5];
  int32_t empty_step = 0;
  soc[0] = of->idle_soc[0];
  temperature_c[0] = of->idle_c[0];
  status = bev_run_within_limits(of->vehicle, trip, &heating, 0, soc, temperature_c, of->room[6],
                                 of->room[7], &empty_step);
  if (status == BEV_OK) {
    arrive(arrival, status, taken_wh(trip, of->room[6]), temperature_c[steps], soc[steps], NAN);
  } else {
    arrive(arrival, status, NAN, NAN, NAN, NAN);
  }
}

/* The paper's run, checked as in bev_preheat.planning.no_regret; writes `heater_w` and the instant (NaN: none). */
static bev_status plan_paper(const drive *of, double *heater_w, double *instant_s) {
  double *soc = of->room[2];
  double *temperature_c = of->room[3];
  soc[0] = of->idle_soc[0];
  temperature_c[0] = of->idle_c[0];
  bev_status status = bev_run_paper(of->vehicle, &of->trip, of->target_c, soc, temperature_c,
                                    heater_w, instant_s);
  if (status == BEV_OK) {
    status = bev_is_driven_as_planned(of->vehicle, &of->trip, soc, temperature_c, heater_w,
                                      of->room[6], of->room[7]);
  }
  return status != BEV_OK || leaves_enough(of, soc) ? status : BEV_LIMITED;
}

static void paper(const drive *of, const bev_arrival *unheated, bev_arrival *arrival) {
  const bev_trip *trip = &of->trip;
  double *heater_w = of->room[4];
  double *soc = of->room[2];
  double *temperature_c = of->room[3];
  double instant_s = NAN;
  bev_status status = plan_paper(of, heater_w, &instant_s);
  if (status == BEV_OK && isnan(instant_s)) {
    *arrival = *unheated;
    return;
  }
  if (status == BEV_OK) {
    const int32_t first = bev_step_at(trip, instant_s);
    soc[first] = of->idle_soc[first];
    temperature_c[first] = of->idle_c[first];
    status = bev_run(of->vehicle, BEV_RUNGE_KUTTA_4, trip, first, heater_w, NULL, soc, temperature_c);
  }
  if (status == BEV_OK) {
    arrive(arrival, status, taken_wh(trip, heater_w), temperature_c[trip->steps], soc[trip->steps],
           instant_s);
  } else {
    arrive(arrival, status, NAN, NAN, NAN, NAN);
  }
}

/* All ways of one trip, from a start. */
static void drive_each_way(drive *of, double start_soc, double start_c, bev_arrival *arrivals) {
  const int32_t steps = of->trip.steps;
  double *soc = of->room[SWITCH_ROOMS];
  double *temperature_c = of->room[SWITCH_ROOMS + 1];
  double *heater_w = of->room[SWITCH_ROOMS + 2];
  bev_switch_plan plan;
  const bev_status planned = bev_plan_switch(of->vehicle, &of->trip, start_soc, start_c, of->target_c,
                                             1, of->room[0], soc, temperature_c, heater_w, &plan);
  const bev_status unheated =
      planned == BEV_OK && plan.unheated_keeps_limits == 0 ? BEV_LIMITED : planned;
  if (unheated != BEV_OK) {
    for (int32_t way = 0; way < BEV_WAYS; way++) {
      arrive(&arrivals[way], unheated, NAN, NAN, NAN, NAN);
    }
    return;
  }
  arrive(&arrivals[BEV_UNHEATED], BEV_OK, 0.0, of->idle_c[steps], of->idle_soc[steps], NAN);
  if (plan.keeps_limits != 0 && leaves_enough(of, soc)) {
    arrive(&arrivals[BEV_ONE_SWITCH], BEV_OK, plan.energy_wh.hvch_electric, temperature_c[steps],
           soc[steps], plan.switching_instant_s);
  } else {
    arrive(&arrivals[BEV_ONE_SWITCH], BEV_LIMITED, NAN, NAN, NAN, NAN);
  }
  always_on(of, &arrivals[BEV_ALWAYS_ON]);
  paper(of, &arrivals[BEV_UNHEATED], &arrivals[BEV_PAPER]);
}

/* The trip that begins at a step of `trips`, with its own time. */
static bev_trip trip_at(const bev_trip *trips, int32_t first, int32_t steps, double *time_s) {
  const bev_trip trip = {steps,
                         time_s,
                         &trips->duration_s[first],
                         &trips->idle_power_w[first],
                         &trips->power_variance_w2[first],
                         &trips->idle_heat_w[first],
                         &trips->leakage_w_per_k[first],
                         &trips->heater_limit_w[first],
                         &trips->propulsion_power_w[first],
                         &trips->drivetrain_heat_w[first],
                         &trips->ambient_temperature_c[first]};
  time_s[0] = 0.0;
  for (int32_t k = 0; k < steps; k++) {
    time_s[k + 1] = time_s[k] + trip.duration_s[k];
  }
  return trip;
}

/* Whether the lengths of the trips add up to `total` steps, each at most `longest`. */
static int are_trips(int32_t total, int32_t count, const int32_t *steps, int32_t longest) {
  int32_t left = total;
  for (int32_t n = 0; n < count; n++) {
    if (steps[n] < 1 || steps[n] > longest || steps[n] > left) {
      return 0;
    }
    left -= steps[n];
  }
  return left == 0;
}

bev_status bev_plan_trips(const bev_vehicle *vehicle, const bev_trip *trips, int32_t count,
                          const int32_t *steps, const double *start_soc, const double *start_c,
                          const double *target_c, double reserve_soc, double lowest_soc,
                          int32_t longest, double *memory, uint8_t *flags,
                          bev_arrival *arrivals) {
  const bev_status status = bev_checked(vehicle, trips, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (count < 0 || longest < 1 || longest > BEV_MOST_STEPS || steps == NULL || start_soc == NULL
      || start_c == NULL || target_c == NULL || memory == NULL || flags == NULL || arrivals == NULL
      || vehicle->heater_lag_s > 0.0 || vehicle->coolant_heat_capacity_j_per_k > 0.0
      || !are_trips(trips->steps, count, steps, longest)) {
    return BEV_BAD_ARGUMENT;
  }
  if (!isfinite(reserve_soc) || !isfinite(lowest_soc)) {
    return BEV_BAD_INPUT;
  }
  drive of;
  of.vehicle = vehicle;
  of.reserve_soc = reserve_soc;
  of.lowest_soc = lowest_soc;
  of.may_overcharge = flags;
  int32_t first = 0;
  for (int32_t n = 0; n < count; n++) {
    /* bev_plan_switch lays its arrays out by the steps of the trip. */
    for (int32_t room = 0; room < ROOMS; room++) {
      of.room[room] = &memory[room * (steps[n] + 1)];
    }
    of.may_overdraw = &flags[steps[n]];
    of.trip = trip_at(trips, first, steps[n], of.room[ROOMS - 1]);
    of.idle_soc = of.room[0];
    of.idle_c = of.room[1];
    of.target_c = target_c[n];
    drive_each_way(&of, start_soc[n], start_c[n], &arrivals[n * BEV_WAYS]);
    first += steps[n];
  }
  return BEV_OK;
}
