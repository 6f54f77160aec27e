/* SPDX-License-Identifier: Apache-2.0 */
/*
 * When to switch the heater on, heat at once: bev_preheat.planning.one_interval with the search of
 * bev_preheat.planning.bracketing, and the cost of the plan found.
 */
#include "bev_preheat_core_generated/constants.h"
#include "bracketing.h"
#include "checks.h"
#include "parts_of_plans.h"
#include "steps_of_model.h"

/* The constant inputs of the search for the instant, and the memory of each trial. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  const double *idle_soc;
  const double *idle_c;
  bev_means idle_means;
  double target_c;
  double *soc;
  double *temperature_c;
  double *heater_w;
  bev_means means;
} switch_search;

/* The run heated from an instant on, and unheated before; its excess over the target on arrival. */
static bev_status switch_on_at(void *searched, double instant_s, double *above_k) {
  const switch_search *of = (const switch_search *)searched;
  const bev_trip *trip = of->trip;
  const int32_t first = bev_step_at(trip, instant_s);
  for (int32_t k = 0; k <= first; k++) {
    of->soc[k] = of->idle_soc[k];
    of->temperature_c[k] = of->idle_c[k];
  }
  for (int32_t k = 0; k < first && of->means.temperature_c != NULL; k++) {
    of->means.temperature_c[k] = of->idle_means.temperature_c[k];
    of->means.joule_w[k] = of->idle_means.joule_w[k];
  }
  for (int32_t k = 0; k < trip->steps; k++) {
    const double share_on = (trip->time_s[k + 1] - instant_s) / trip->duration_s[k];
    of->heater_w[k] = bev_minimum(bev_maximum(share_on, 0.0), 1.0) * trip->heater_limit_w[k];
  }
  const bev_status status =
      bev_run_with_means(of->vehicle, BEV_RUNGE_KUTTA_4, trip, first, of->heater_w, NULL, of->soc,
                         of->temperature_c, of->means);
  *above_k = of->temperature_c[trip->steps] - of->target_c;
  return status;
}

/* Rate of temperature change at the start of a step of the run, so much warmer, under a heater power. */
static double rate_k_per_s(const switch_search *of, int32_t k, double warmer_k, double heater_w) {
  const bev_trip *trip = of->trip;
  double result[3];
  bev_rates(of->vehicle, BEV_SATURATING, of->soc[k], of->temperature_c[k] + warmer_k,
            trip->idle_power_w[k] + heater_w, trip->power_variance_w2[k],
            bev_heat_with_heater_w(of->vehicle, trip->idle_heat_w[k], heater_w),
            trip->leakage_w_per_k[k], result);
  return result[1];
}

/* Change of the arrival temperature with the switching instant [K/s], an estimate. */
static double arrival_slope_k_per_s(const switch_search *of, double instant_s) {
  const bev_trip *trip = of->trip;
  const int32_t first = bev_step_at(trip, instant_s);
  const double gained_k_per_s = rate_k_per_s(of, first, 0.0, trip->heater_limit_w[first])
      - rate_k_per_s(of, first, 0.0, 0.0);
  const int32_t middle = (first + trip->steps) / 2;
  const double full_w = trip->heater_limit_w[middle];
  const double damping_per_s =
      rate_k_per_s(of, middle, 0.0, full_w) - rate_k_per_s(of, middle, 1.0, full_w);
  return -gained_k_per_s * exp(-damping_per_s * (trip->time_s[trip->steps] - instant_s));
}

/* Approximate state of charge on arrival: that of the unheated run less the charge for heating. */
static double terminal_soc(const switch_search *of) {
  const bev_vehicle *vehicle = of->vehicle;
  const double idle_soc = of->idle_soc[of->trip->steps];
  const double idle_c = of->idle_c[of->trip->steps];
  const double heating_j = BEV_HEATING_ALLOWANCE * vehicle->heat_capacity_j_per_k
      * (of->target_c - idle_c) / vehicle->heater_efficiency;
  const double voltage_v =
      bev_at(&vehicle->open_circuit_voltage, BEV_SATURATING, idle_soc, idle_c);
  return bev_maximum(idle_soc - heating_j / (voltage_v * (3600.0 * vehicle->capacity_ah)), 0.0);
}

/* The whole search, from the first guess on. */
static bev_status find_switch(switch_search *of, double *instant_s) {
  const bev_trip *trip = of->trip;
  const double arrival_s = trip->time_s[trip->steps];
  if (!isfinite(of->target_c) || !isfinite(of->idle_soc[trip->steps])
      || !bev_is_time(trip)) {
    return BEV_BAD_INPUT;
  }
  double guess_s = 0.0;
  double above_k = 0.0;
  bev_status status =
      bev_find_crossing(of->vehicle, BEV_MIDPOINT, trip, of->target_c, terminal_soc(of),
                        BEV_LOST_ABOVE_TARGET_K, of->idle_c, &guess_s);
  if (status < BEV_OK) {
    return status;
  }
  *instant_s = status == BEV_NO_CROSSING ? 0.0
                                         : bev_minimum(bev_maximum(guess_s, 0.0), arrival_s);
  status = switch_on_at(of, *instant_s, &above_k);
  if (status < BEV_OK) {
    return status;
  }
  const double slope = arrival_slope_k_per_s(of, *instant_s);
  if (!isfinite(slope)) {
    return BEV_NOT_FINITE;
  }
  const bev_ending ending = {BEV_ARRIVAL_TOLERANCE_K, 0.0, BEV_MOST_TRIALS};
  return bev_follow_slope(0.0, arrival_s, slope, &ending, switch_on_at, of, instant_s, &above_k);
}

bev_status bev_find_switch(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                           const double *idle_soc, const double *idle_c, double *soc, double *temperature_c,
                           double *heater_w, double *instant_s) {
  const bev_status status = bev_checked(vehicle, trip, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (trip->steps < 1 || idle_soc == NULL || idle_c == NULL || soc == NULL
      || temperature_c == NULL || heater_w == NULL || instant_s == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  const bev_means none = {NULL, NULL};
  switch_search of = {vehicle, trip, idle_soc, idle_c, none, target_c, soc, temperature_c, heater_w, none};
  return find_switch(&of, instant_s);
}

bev_status bev_keeps_limits(const bev_seen_run *run, int32_t first) {
  const bev_vehicle *vehicle = run->vehicle;
  const bev_trip *trip = run->trip;
  for (int32_t k = first; k <= trip->steps; k++) {
    if (!(run->temperature_c[k] <= vehicle->highest_c
          && run->temperature_c[k] >= vehicle->lowest_c && run->soc[k] > 0.0
          && run->soc[k] <= 1.0)) {
      return BEV_LIMITED;
    }
  }
  const bev_status status = bev_limits_of_steps(
      vehicle, trip->steps - first, &run->soc[first], &run->temperature_c[first],
      &trip->power_variance_w2[first], &run->least_w[first], &run->most_w[first]);
  if (status != BEV_OK) {
    return status;
  }
  for (int32_t k = first; k < trip->steps; k++) {
    const double terminal_w = trip->idle_power_w[k] + run->heater_w[k];
    if (!(terminal_w >= run->least_w[k] && terminal_w <= run->most_w[k])) {
      return BEV_LIMITED;
    }
  }
  return BEV_OK;
}

/*
 * The least and the most terminal power [W] that keep the limits at both ends of a step, for a battery BEV_COLDER_BY_K
 * colder, but not below the vehicle's range: a limit may matter there.
 */
static bev_status limits_of_colder_step(const bev_vehicle *vehicle, const double soc[2],
                                        const double temperature_c[2], double variance_w2, double limits_w[2]) {
  double end_w[2];
  bev_terminal_limits(vehicle, BEV_AS_ARRAYS, soc[0],
                      bev_maximum(temperature_c[0] - BEV_COLDER_BY_K, vehicle->lowest_c), variance_w2, limits_w);
  bev_terminal_limits(vehicle, BEV_AS_ARRAYS, soc[1],
                      bev_maximum(temperature_c[1] - BEV_COLDER_BY_K, vehicle->lowest_c), variance_w2, end_w);
  if (!isfinite(limits_w[0]) || !isfinite(limits_w[1]) || !isfinite(end_w[0])
      || !isfinite(end_w[1])) {
    return BEV_NOT_FINITE;
  }
  limits_w[0] = bev_maximum(limits_w[0], end_w[0]);
  limits_w[1] = bev_minimum(limits_w[1], end_w[1]);
  return BEV_OK;
}

/* The reason for a heating interval: the first thing after it that a colder battery would not allow. */
static bev_status find_reason(const bev_seen_run *run, bev_switch_plan *plan) {
  const bev_trip *trip = run->trip;
  plan->reason = BEV_FOR_ARRIVAL;
  for (int32_t k = plan->end_heated; k < trip->steps; k++) {
    double limits_w[2];
    const bev_status status =
        limits_of_colder_step(run->vehicle, &run->soc[k], &run->temperature_c[k],
                                  trip->power_variance_w2[k], limits_w);
    if (status != BEV_OK) {
      return status;
    }
    if (trip->idle_power_w[k] > limits_w[1]) {
      plan->reason = BEV_FOR_CLIMB;
      return BEV_OK;
    }
    if (trip->propulsion_power_w[k] < 0.0 && trip->idle_power_w[k] < limits_w[0]) {
      plan->reason = BEV_FOR_DESCENT;
      return BEV_OK;
    }
  }
  return BEV_OK;
}

/* The heated steps: first and last, their energy, and their reason, if they form one paid interval. */
static bev_status find_interval(const bev_seen_run *run, bev_switch_plan *plan) {
  const bev_trip *trip = run->trip;
  double heating_j = 0.0;
  plan->is_heated = 0;
  plan->is_one_interval = 1;
  plan->first_heated = trip->steps;
  plan->end_heated = trip->steps;
  for (int32_t k = 0; k < trip->steps; k++) {
    const double heater_w = run->heater_w[k];
    plan->is_heated = heater_w != 0.0 ? 1 : plan->is_heated;
    if (bev_is_heated(trip, run->heater_w, k) != 0) {
      if (plan->first_heated == trip->steps) {
        plan->first_heated = k;
      } else if (plan->end_heated < k) {
        plan->is_one_interval = 0;
      } else {
        /* The interval goes on. */
      }
      plan->end_heated = k + 1;
      heating_j += heater_w * trip->duration_s[k];
      if (trip->propulsion_power_w[k] < 0.0
          && heater_w <= run->least_w[k] - trip->idle_power_w[k] + BEV_ROUNDING_W) {
        plan->is_one_interval = 0;
      }
    }
  }
  plan->interval_wh = heating_j / BEV_JOULES_PER_WH;
  return find_reason(run, plan);
}

static double least_of(const double *values, int32_t count) {
  double least = values[0];
  for (int32_t n = 1; n < count; n++) {
    least = bev_minimum(least, values[n]);
  }
  return least;
}

/* Plan a run from the unheated run, and find whether both keep the limits; `run` becomes that of the plan. */
static bev_status plan_run(switch_search *of, bev_seen_run *run, int32_t in_one_interval, bev_switch_plan *plan) {
  const int32_t steps = of->trip->steps;
  for (int32_t k = 0; k < steps; k++) {
    of->heater_w[k] = 0.0;
  }
  bev_status status = bev_keeps_limits(run, 0);
  if (status < BEV_OK) {
    return status;
  }
  plan->unheated_keeps_limits = status == BEV_OK ? 1 : 0;
  plan->keeps_limits = plan->unheated_keeps_limits;
  plan->costs_least = 1;
  if (of->idle_c[steps] >= of->target_c) {
    for (int32_t k = 0; k <= steps; k++) {
      of->soc[k] = of->idle_soc[k];
      of->temperature_c[k] = of->idle_c[k];
    }
    return BEV_OK;
  }
  status = find_switch(of, &plan->switching_instant_s);
  if (status < BEV_OK) {
    return status;
  }
  run->soc = of->soc;
  run->temperature_c = of->temperature_c;
  /* Until it is switched on, the plan is the unheated run, whose limits are known if it keeps them. */
  status = bev_keeps_limits(run, plan->unheated_keeps_limits != 0
                                     ? bev_step_at(of->trip, plan->switching_instant_s)
                                     : 0);
  plan->keeps_limits = status == BEV_OK ? 1 : 0;
  if (status == BEV_OK && in_one_interval == 0) {
    status = bev_costs_least(of->vehicle, of->trip, of->soc, of->temperature_c, of->heater_w);
    plan->costs_least = status == BEV_OK ? 1 : 0;
  }
  return status < BEV_OK ? status : BEV_OK;
}

bev_status bev_plan_switch(const bev_vehicle *vehicle, const bev_trip *trip, double start_soc, double start_c,
                           double target_c, int32_t in_one_interval, double *memory, double *soc,
                           double *temperature_c, double *heater_w, bev_switch_plan *plan) {
  bev_status status = bev_checked(vehicle, trip, 0);
  if (status != BEV_OK) {
    return status;
  }
  if (trip->steps < 1 || memory == NULL || soc == NULL || temperature_c == NULL
      || heater_w == NULL || plan == NULL || vehicle->heater_lag_s > 0.0
      || vehicle->coolant_heat_capacity_j_per_k > 0.0) {
    return BEV_BAD_ARGUMENT;
  }
  if (!isfinite(target_c)) {
    return BEV_BAD_INPUT;
  }
  const int32_t steps = trip->steps;
  double *room[8];
  for (int32_t n = 0; n < 8; n++) {
    room[n] = &memory[n * (steps + 1)];
  }
  const bev_means idle_means = {room[2], room[3]};
  const bev_means means = {room[4], room[5]};
  switch_search of = {vehicle, trip, room[0], room[1], idle_means, target_c, soc, temperature_c, heater_w, means};
  bev_seen_run run = {vehicle, trip, room[0], room[1], heater_w, room[6], room[7]};
  room[0][0] = start_soc;
  room[1][0] = start_c;
  status = bev_run_with_means(vehicle, BEV_RUNGE_KUTTA_4, trip, 0, NULL, NULL,
                                                 room[0], room[1], idle_means);
  if (status < BEV_OK) {
    return status;
  }
  plan->switching_instant_s = NAN;
  status = plan_run(&of, &run, in_one_interval, plan);
  if (status != BEV_OK || plan->keeps_limits == 0 || plan->costs_least == 0) {
    return status;
  }
  plan->least_soc = least_of(run.soc, steps + 1);
  status = find_interval(&run, plan);
  if (status != BEV_OK) {
    return status;
  }
  /* The circuit's own limit lies at the battery's or above it, so all power is deliverable. */
  const bev_run_of_powers made = {1, soc, temperature_c, heater_w, NULL, NULL};
  return bev_energies_of_means(vehicle, trip, &made, run.soc == soc ? means : idle_means,
                               &plan->energy_wh);
}
