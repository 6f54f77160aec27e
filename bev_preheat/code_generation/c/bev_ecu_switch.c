/* SPDX-License-Identifier: Apache-2.0 */
/* The method optimal_switch: a plan with one heating interval, for vehicles with and without a heat path. */
#include "bev_ecu_shared.h"

#include <math.h>
#include <stddef.h>

#include "limited_run.h"
#include "parts_of_plans.h"

bev_ecu_room bev_ecu_room_in(double *memory, int32_t steps, int32_t rows) {
  bev_ecu_room room;
  room.states = memory;
  room.command_w = &room.states[rows * (steps + 1)];
  room.idle_states = &room.command_w[steps];
  room.least_w = &room.idle_states[rows * (steps + 1)];
  room.most_w = &room.least_w[steps];
  room.heat_w = &room.most_w[steps];
  room.search = &room.heat_w[2 * steps];
  return room;
}

void bev_ecu_start(const bev_vehicle *vehicle, const bev_trip *trip,
                   const bev_ecu_situation *situation, double *states) {
  const int32_t instants = trip->steps + 1;
  states[0] = situation->soc;
  states[instants] = situation->temperature_c;
  if (bev_is_direct(vehicle) == 0) {
    states[2 * instants] = situation->heater_w;
    states[3 * instants] = situation->coolant_excess_k;
  }
}

/* BEV_OK if a run under the commands of `room` keeps all limits; writes heater power and arriving heat. */
static bev_status keeps_limits(const bev_vehicle *vehicle, const bev_trip *trip,
                               const double *states, const bev_ecu_room *room) {
  const double *drawn_w = room->command_w;
  if (bev_is_direct(vehicle) == 0) {
    const bev_status status =
        bev_heat_along(vehicle, trip, states, room->command_w, room->heat_w);
    if (status != BEV_OK) {
      return status;
    }
    drawn_w = room->heat_w;
  }
  const bev_seen_run run = {vehicle, trip,          states,      &states[trip->steps + 1],
                            drawn_w, room->least_w, room->most_w};
  return bev_keeps_limits(&run, 0);
}

bev_status bev_ecu_run_idle(const bev_vehicle *vehicle, const bev_trip *trip,
                            const bev_ecu_situation *situation, const bev_ecu_room *room) {
  double *const states = room->idle_states;
  for (int32_t k = 0; k < trip->steps; k++) {
    room->command_w[k] = 0.0;
  }
  bev_ecu_start(vehicle, trip, situation, states);
  const bev_status status = bev_is_direct(vehicle) != 0
      ? bev_run(vehicle, BEV_RUNGE_KUTTA_4, trip, 0, NULL, NULL, states,
                &states[trip->steps + 1])
      : bev_run_heated(vehicle, trip, room->command_w, states, NULL);
  return status < BEV_OK ? status : keeps_limits(vehicle, trip, states, room);
}

bev_status bev_ecu_plan_interval(const bev_vehicle *vehicle, const bev_trip *trip,
                                 const bev_ecu_situation *situation, const bev_ecu_room *room,
                                 bev_ecu_plan *plan) {
  const int32_t steps = trip->steps;
  const int32_t instants = steps + 1;
  const double *const idle_states = room->idle_states;
  const double *states = idle_states;
  double on_s = 0.0;
  double off_s = trip->time_s[steps];
  bev_status status = BEV_OK;
  for (int32_t k = 0; k < steps; k++) {
    room->command_w[k] = 0.0;
  }
  if (idle_states[instants + steps] < situation->target_c) {
    states = room->states;
    status = bev_is_direct(vehicle) != 0
        ? bev_find_switch(vehicle, trip, situation->target_c, idle_states, &idle_states[instants],
                          room->states, &room->states[instants], room->command_w, &on_s)
        : bev_find_two_switches(vehicle, trip, situation->target_c, idle_states, room->search,
                                room->states, room->command_w, NULL, &on_s, &off_s);
    if (status < BEV_OK) {
      return status;
    }
  }
  status = keeps_limits(vehicle, trip, states, room);
  if (status != BEV_OK) {
    return status;
  }
  plan->soc = states;
  plan->temperature_c = &states[instants];
  plan->heater_w = room->command_w;
  bev_ecu_tell_instants(vehicle, trip, room->command_w, on_s, off_s, plan);
  return bev_ecu_keep_accounts(vehicle, trip, room->heat_w, plan);
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
  const bev_ecu_room room =
      bev_ecu_room_in(memory, trip->steps, bev_is_direct(vehicle) != 0 ? 2 : 4);
  bev_ecu_begin(plan);
  status = bev_ecu_run_idle(vehicle, trip, situation, &room);
  if (status == BEV_OK) {
    status = bev_ecu_plan_interval(vehicle, trip, situation, &room, plan);
  }
  return status == BEV_OK ? bev_ecu_conclude(trip, situation, 0.0, plan) : status;
}
