/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The method optimal_switch: a plan with one heating interval, for vehicles with and without a heat path, or
 * that a limit is active.
 */
#include "bev_ecu_shared.h"

#include <math.h>
#include <stddef.h>

#include "bev_preheat_core_generated/constants.h"
#include "limits_of_run.h"

/* Arrays of a run with a heat path, in the caller's memory. */
typedef struct {
  double *idle_states;
  double *states;
  double *search;
  double *command_w;
  /* Heater power and arriving heat, two arrays. */
  double *heat_w;
  double *least_w;
  double *most_w;
} late_room;

/* BEV_OK if a run keeps all limits of the battery; writes the heater power and the arriving heat along it. */
static bev_status follow_heat(const bev_vehicle *vehicle, const bev_trip *trip,
                              const double *states, const late_room *room) {
  const bev_status status =
      bev_heat_along(vehicle, trip, states, room->command_w, NULL, room->heat_w);
  if (status != BEV_OK) {
    return status;
  }
  const bev_seen_run run = {vehicle,      trip,         states,      &states[trip->steps + 1],
                            room->heat_w, room->least_w, room->most_w};
  return bev_keeps_limits(&run, 0);
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
    bev_ecu_tell_instants(trip, room.command_w, on_s, off_s, plan);
  }
  plan->soc = states;
  plan->temperature_c = &states[instants];
  plan->heater_w = room.command_w;
  /* The circuit's own limit lies at the battery's or above it, so all power is deliverable. */
  const bev_run_of_powers made = {1, plan->soc, plan->temperature_c, room.heat_w,
                                  &room.heat_w[steps], NULL};
  status = bev_keep_accounts(vehicle, BEV_RUNGE_KUTTA_4, trip, &made, NULL, &plan->energy_wh);
  const double after_wh = vehicle->heater_lag_s * states[2 * instants + steps] / BEV_JOULES_PER_WH;
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

bev_status bev_ecu_plan_switch(const bev_vehicle *vehicle, const bev_trip *trip,
                               const bev_ecu_situation *situation, double *memory,
                               bev_ecu_plan *plan) {
  if (memory == NULL || plan == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  bev_status status = bev_ecu_check(vehicle, trip, situation);
  if (status != BEV_OK) {
    return status;
  }
  plan->on_s = NAN;
  plan->off_s = NAN;
  plan->deficit_w = 0.0;
  plan->brake_w = NULL;
  status = bev_ecu_arrives_late(vehicle) ? plan_late(vehicle, trip, situation, memory, plan)
                                         : plan_direct(vehicle, trip, situation, memory, plan);
  return status == BEV_OK ? bev_ecu_conclude(trip, situation, plan) : status;
}
