/* SPDX-License-Identifier: Apache-2.0 */
/* A plan with one stretch of heating, for vehicles with and without a heat path, or that a limit is active. */
#include "bev_ecu.h"

#include <math.h>
#include <stddef.h>

#define JOULES_PER_WH 3600.0
/* Instants and durations of a trip agree to this [s], for rounding. */
#define TIME_TOLERANCE_S 1e-6

static int is_between(double value, double low, double high) {
  return value >= low && value <= high;
}

static int is_not_negative(double value) { return isfinite(value) && value >= 0.0; }

static int is_trip(const bev_trip *trip) {
  return trip->steps >= 1 && trip->steps <= BEV_MOST_STEPS && trip->time_s != NULL
      && trip->duration_s != NULL && trip->idle_power_w != NULL && trip->power_variance_w2 != NULL
      && trip->idle_heat_w != NULL && trip->leakage_w_per_k != NULL && trip->heater_limit_w != NULL
      && trip->propulsion_power_w != NULL && trip->drivetrain_heat_w != NULL
      && trip->ambient_temperature_c != NULL;
}

/* BEV_OK if each number of a trip can be one. */
static bev_status check_steps(const bev_trip *trip) {
  if (!isfinite(trip->time_s[0])) {
    return BEV_BAD_INPUT;
  }
  for (int32_t k = 0; k < trip->steps; k++) {
    const double difference_s = trip->time_s[k + 1] - trip->time_s[k] - trip->duration_s[k];
    if (!isfinite(trip->duration_s[k]) || !(trip->duration_s[k] > 0.0)
        || !(fabs(difference_s) <= TIME_TOLERANCE_S) || !isfinite(trip->idle_power_w[k])
        || !is_not_negative(trip->power_variance_w2[k]) || !isfinite(trip->idle_heat_w[k])
        || !is_not_negative(trip->leakage_w_per_k[k]) || !is_not_negative(trip->heater_limit_w[k])
        || !isfinite(trip->propulsion_power_w[k]) || !isfinite(trip->drivetrain_heat_w[k])
        || !isfinite(trip->ambient_temperature_c[k])) {
      return BEV_BAD_INPUT;
    }
  }
  return BEV_OK;
}

static bev_status check_situation(const bev_vehicle *vehicle, const bev_ecu_situation *situation) {
  return is_between(situation->soc, 0.0, 1.0)
          && is_between(situation->temperature_c, vehicle->lowest_c, vehicle->highest_c)
          && is_between(situation->target_c, vehicle->lowest_c, vehicle->highest_c)
          && is_not_negative(situation->heater_w) && isfinite(situation->coolant_excess_k)
          && is_between(situation->reserve_soc, 0.0, 1.0)
          && is_between(situation->least_soc, 0.0, 1.0)
      ? BEV_OK
      : BEV_BAD_INPUT;
}

/* Arrays of a run with a heat path, in the memory that was given. */
typedef struct {
  double *idle_states;
  double *states;
  double *search;
  double *command_w;
  /* What the heater takes and what arrives, two arrays. */
  double *heat_w;
  double *least_w;
  double *most_w;
} late_room;

/* BEV_OK if a run keeps all limits of the battery; written is what heater and coolant do in it. */
static bev_status follow_heat(const bev_vehicle *vehicle, const bev_trip *trip,
                              const double *states, const late_room *room) {
  const int32_t steps = trip->steps;
  const double *temperature_c = &states[steps + 1];
  bev_status status = bev_heat_along(vehicle, trip, states, room->command_w, NULL, room->heat_w);
  if (status != BEV_OK) {
    return status;
  }
  status = bev_limits_of_steps(vehicle, steps, states, temperature_c, trip->power_variance_w2,
                               room->least_w, room->most_w);
  if (status != BEV_OK) {
    return status;
  }
  for (int32_t k = 0; k <= steps; k++) {
    if (!is_between(temperature_c[k], vehicle->lowest_c, vehicle->highest_c)
        || !(states[k] > 0.0 && states[k] <= 1.0)) {
      return BEV_LIMITED;
    }
  }
  for (int32_t k = 0; k < steps; k++) {
    if (!is_between(trip->idle_power_w[k] + room->heat_w[k], room->least_w[k], room->most_w[k])) {
      return BEV_LIMITED;
    }
  }
  return BEV_OK;
}

/* The last instant before one at which anything is heated: where the cabin takes all, nothing is. */
static double heated_until_s(const bev_trip *trip, double off_s) {
  for (int32_t k = trip->steps - 1; k >= 0; k--) {
    if (trip->heater_limit_w[k] > 0.0 && trip->time_s[k] < off_s) {
      return off_s < trip->time_s[k + 1] ? off_s : trip->time_s[k + 1];
    }
  }
  return off_s;
}

static void tell_instants(const bev_trip *trip, const double *command_w, double on_s, double off_s,
                          bev_ecu_plan *plan) {
  const double end_s = heated_until_s(trip, off_s);
  for (int32_t k = 0; k < trip->steps; k++) {
    if (command_w[k] != 0.0) {
      plan->on_s = on_s;
      plan->off_s = end_s < trip->time_s[trip->steps] ? end_s : NAN;
      return;
    }
  }
}

/* The plan of a vehicle whose heat arrives late. */
static bev_status plan_late(const bev_vehicle *vehicle, const bev_trip *trip,
                            const bev_ecu_situation *situation, double *memory,
                            bev_ecu_plan *plan) {
  const int32_t steps = trip->steps;
  const int32_t instants = steps + 1;
  late_room room;
  room.idle_states = memory;
  room.states = &room.idle_states[4 * instants];
  room.command_w = &room.states[4 * instants];
  room.heat_w = &room.command_w[steps];
  room.least_w = &room.heat_w[2 * steps];
  room.most_w = &room.least_w[steps];
  room.search = &room.most_w[steps];
  for (int32_t k = 0; k < steps; k++) {
    room.command_w[k] = 0.0;
  }
  room.idle_states[0] = situation->soc;
  room.idle_states[instants] = situation->temperature_c;
  room.idle_states[2 * instants] = situation->heater_w;
  room.idle_states[3 * instants] = situation->coolant_excess_k;
  bev_status status = bev_run_heated(vehicle, trip, 0, room.command_w, NULL, room.idle_states);
  if (status < BEV_OK) {
    return status;
  }
  status = follow_heat(vehicle, trip, room.idle_states, &room);
  if (status != BEV_OK) {
    return status;
  }
  const double *states = room.idle_states;
  if (states[instants + steps] < situation->target_c) {
    double on_s = 0.0;
    double off_s = 0.0;
    status = bev_find_two_switches(vehicle, trip, situation->target_c, room.idle_states,
                                   room.search, room.states, room.command_w, &on_s, &off_s);
    if (status < BEV_OK) {
      return status;
    }
    states = room.states;
    status = follow_heat(vehicle, trip, states, &room);
    if (status != BEV_OK) {
      return status;
    }
    tell_instants(trip, room.command_w, on_s, off_s, plan);
  }
  plan->soc = states;
  plan->temperature_c = &states[instants];
  plan->heater_w = room.command_w;
  /* The circuit's own limit lies at the battery's or above it, so all power is deliverable. */
  const bev_run_of_powers made = {1, plan->soc, plan->temperature_c, room.heat_w,
                                  &room.heat_w[steps], NULL};
  status = bev_keep_accounts(vehicle, BEV_RUNGE_KUTTA_4, trip, &made, NULL, &plan->energy_wh);
  const double after_wh = vehicle->heater_lag_s * states[2 * instants + steps] / JOULES_PER_WH;
  plan->energy_wh.hvch_electric += after_wh;
  plan->energy_wh.battery_total += after_wh;
  return status;
}

/* The plan of a vehicle whose heat arrives at once. */
static bev_status plan_direct(const bev_vehicle *vehicle, const bev_trip *trip,
                              const bev_ecu_situation *situation, double *memory,
                              bev_ecu_plan *plan) {
  const int32_t steps = trip->steps;
  double *soc = &memory[BEV_SWITCH_MEMORY(steps)];
  double *temperature_c = &soc[steps + 1];
  double *heater_w = &temperature_c[steps + 1];
  bev_switch_plan found;
  const bev_status status =
      bev_plan_switch(vehicle, trip, situation->soc, situation->temperature_c, situation->target_c,
                      1, NULL, memory, soc, temperature_c, heater_w, &found);
  if (status != BEV_OK) {
    return status;
  }
  plan->on_s = found.is_heated != 0 ? found.switching_instant_s : NAN;
  plan->energy_wh = found.energy_wh;
  plan->soc = soc;
  plan->temperature_c = temperature_c;
  plan->heater_w = heater_w;
  return BEV_OK;
}

/* What is told of the run that is planned; BEV_LIMITED where it does not leave the charge it must. */
static bev_status conclude(const bev_trip *trip, const bev_ecu_situation *situation,
                           bev_ecu_plan *plan) {
  const double lacking_k = situation->target_c - plan->temperature_c[trip->steps];
  plan->arrival_c = plan->temperature_c[trip->steps];
  plan->arrival_soc = plan->soc[trip->steps];
  plan->shortfall_k = lacking_k > 0.0 ? lacking_k : 0.0;
  plan->least_soc = plan->soc[0];
  for (int32_t k = 1; k <= trip->steps; k++) {
    if (plan->soc[k] < plan->least_soc) {
      plan->least_soc = plan->soc[k];
    }
  }
  return plan->arrival_soc >= situation->reserve_soc && plan->least_soc >= situation->least_soc
      ? BEV_OK
      : BEV_LIMITED;
}

bev_status bev_ecu_plan_switch(const bev_vehicle *vehicle, const bev_trip *trip,
                               const bev_ecu_situation *situation, double *memory,
                               bev_ecu_plan *plan) {
  if (vehicle == NULL || trip == NULL || situation == NULL || memory == NULL || plan == NULL
      || !is_trip(trip)) {
    return BEV_BAD_ARGUMENT;
  }
  bev_status status = bev_check_vehicle(vehicle);
  if (status == BEV_OK) {
    status = check_steps(trip);
  }
  if (status == BEV_OK) {
    status = check_situation(vehicle, situation);
  }
  if (status != BEV_OK) {
    return status;
  }
  plan->on_s = NAN;
  plan->off_s = NAN;
  status = vehicle->heater_lag_s > 0.0 || vehicle->coolant_heat_capacity_j_per_k > 0.0
      ? plan_late(vehicle, trip, situation, memory, plan)
      : plan_direct(vehicle, trip, situation, memory, plan);
  return status == BEV_OK ? conclude(trip, situation, plan) : status;
}
