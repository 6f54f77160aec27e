/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The method merit_order: a plan within the limits of the battery, and the check whether it may be used: no plan may
 * be worse than not heating (bev_preheat.planning.no_regret).
 */
#include "bev_ecu_shared.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#include "bev_preheat_core_generated/constants.h"
#include "trajectory.h"
#include "limits_of_run.h"
#include "surplus_ceiling.h"

/* Working memory of the plan; runs are as of bev_settle. */
typedef struct {
  int32_t rows;
  double *idle_states;
  double *states;
  double *powers_w;
  /* Arrays of a plan under a ceiling on free heat, and the ceiling. */
  double *bounded_states;
  double *bounded_powers_w;
  double *ceiling_c;
  double *along_c;
  double *work;
  uint8_t *watched;
  int32_t *order;
} merit_room;

/* The run without any heating, ignoring limits. */
static bev_status run_idle(const bev_vehicle *vehicle, const bev_trip *trip,
                           const bev_ecu_situation *situation, const merit_room *room) {
  const int32_t instants = trip->steps + 1;
  double *const states = room->idle_states;
  bev_status status = BEV_OK;
  states[0] = situation->soc;
  states[instants] = situation->temperature_c;
  if (room->rows == 2) {
    status = bev_run(vehicle, BEV_RUNGE_KUTTA_4, trip, 0, NULL, NULL, states, &states[instants]);
  } else {
    states[2 * instants] = situation->heater_w;
    states[3 * instants] = situation->coolant_excess_k;
    for (int32_t k = 0; k < trip->steps; k++) {
      room->powers_w[k] = 0.0;
    }
    status = bev_run_heated(vehicle, trip, 0, room->powers_w, NULL, states);
  }
  return status < BEV_OK ? status : BEV_OK;
}

/*
 * The largest power deficit allowed for a plan [W]: 0 if the trip without paid heating has no deficit, else hardly
 * more than its deficit. BEV_LIMITED if the charge does not last for that trip. Overwrites the idle run.
 */
static bev_status find_allowed(const bev_vehicle *vehicle, const bev_trip *trip,
                               const merit_room *room, double *allowed_w) {
  const int32_t steps = trip->steps;
  double *const idle_w = room->work;
  double *const powers_w = &idle_w[steps];
  double *const limits_w = &powers_w[room->rows * steps];
  bev_stranding stranding = {-1, 1.0};
  for (int32_t n = 0; n < (1 + room->rows) * steps; n++) {
    room->work[n] = 0.0;
  }
  *allowed_w = 0.0;
  bev_status status = BEV_OK;
  if (room->rows == 4) {
    status = bev_heat_along(vehicle, trip, room->idle_states, idle_w, NULL, &powers_w[2 * steps]);
  }
  if (status == BEV_OK) {
    const bev_seen_run idle = {vehicle, trip, room->idle_states, &room->idle_states[steps + 1],
                               room->rows == 2 ? powers_w : &powers_w[2 * steps], limits_w,
                               &limits_w[steps]};
    status = bev_keeps_limits(&idle, 0);
  }
  if (status != BEV_LIMITED) {
    return status;
  }
  /* Take free heat: surplus that the friction brake would waste. */
  status = bev_drive_as_planned(vehicle, trip, idle_w, room->idle_states, powers_w, room->watched,
                                &stranding);
  if (status == BEV_OK) {
    bev_trajectory trajectory = bev_trajectory_of(room->rows, steps, room->idle_states, powers_w);
    trajectory.stranding = stranding;
    status = bev_deficit_w(vehicle, trip, &trajectory, allowed_w);
  }
  if (*allowed_w > 0.0) {
    *allowed_w += BEV_NO_WORSE_W;
  }
  return status == BEV_OK && stranding.step >= 0 ? BEV_LIMITED : status;
}

/* Energies of a plan, including the energy that a lagging heater takes after arrival. */
static bev_status keep_accounts(const bev_vehicle *vehicle, const bev_trip *trip,
                                const merit_room *room, bev_ecu_plan *plan) {
  const int32_t steps = trip->steps;
  const double *const powers_w = room->powers_w;
  const bool arrives_late = room->rows == 4;
  const bev_run_of_powers made = {plan->deficit_w == 0.0,
                                  plan->soc,
                                  plan->temperature_c,
                                  arrives_late ? &powers_w[2 * steps] : powers_w,
                                  arrives_late ? &powers_w[3 * steps] : NULL,
                                  plan->brake_w};
  const bev_status status =
      bev_keep_accounts(vehicle, BEV_RUNGE_KUTTA_4, trip, &made, NULL, &plan->energy_wh);
  if (status == BEV_OK && arrives_late) {
    const double after_wh =
        vehicle->heater_lag_s * room->states[3 * steps + 2] / BEV_JOULES_PER_WH;
    plan->energy_wh.hvch_electric += after_wh;
    plan->energy_wh.battery_total += after_wh;
  }
  return status;
}

/* The plan for a trip, whose run is written. */
static bev_status plan_run(const bev_vehicle *vehicle, const bev_trip *trip,
                           const bev_ecu_situation *situation, const merit_room *room,
                           double *states, double *powers_w, bev_merit_plan *plan,
                           bev_trajectory *trajectory) {
  const bev_settling goal = {1, situation->target_c, situation->least_soc};
  const bev_status status =
      bev_plan_merit_order(vehicle, trip, &goal, room->idle_states, states, powers_w,
                           room->watched, room->order, room->work, plan);
  *trajectory = bev_trajectory_of(room->rows, trip->steps, states, powers_w);
  trajectory->stranding = plan->stranding;
  return status;
}

/* The plan, computed again under a ceiling on free heat if no useful heat is lost: bev_preheat.planning.free_heat. */
static bev_status plan_useful(const bev_vehicle *vehicle, const bev_trip *trip,
                              const bev_ecu_situation *situation, merit_room *room,
                              bev_merit_plan *found, bev_trajectory *trajectory) {
  const double start[4] = {situation->soc, situation->temperature_c, situation->heater_w,
                           situation->coolant_excess_k};
  bev_status status = plan_run(vehicle, trip, situation, room, room->states, room->powers_w,
                               found, trajectory);
  if (status != BEV_OK || !bev_is_too_warm(trip, situation->target_c, trajectory)) {
    return status;
  }
  bev_trip bounded_trip = *trip;
  const double *soc = room->states;
  double aim_c = situation->target_c + BEV_AIM_K;
  bool is_useful = false;
  for (int32_t n = 0; n < BEV_MOST_CEILINGS && status == BEV_OK && !is_useful; n++) {
    bev_merit_plan bounded;
    bev_trajectory bounded_trajectory;
    status = bev_find_surplus_ceiling(vehicle, trip, start, aim_c, soc, room->work, room->watched,
                                      room->along_c);
    bool is_higher = n == 0;
    for (int32_t k = 0; k < trip->steps && status == BEV_OK; k++) {
      is_higher = is_higher || room->along_c[k] > room->ceiling_c[k] + BEV_HIGHER_K;
      room->ceiling_c[k] = n == 0 || room->along_c[k] > room->ceiling_c[k] ? room->along_c[k]
                                                                          : room->ceiling_c[k];
    }
    if (status == BEV_OK && !is_higher) {
      return status;
    }
    bounded_trip.surplus_ceiling_c = room->ceiling_c;
    if (status == BEV_OK) {
      status = plan_run(vehicle, &bounded_trip, situation, room, room->bounded_states,
                        room->bounded_powers_w, &bounded, &bounded_trajectory);
    }
    if (status == BEV_OK) {
      status = bev_is_as_useful(vehicle, trip, situation->target_c, &bounded_trajectory, trajectory,
                                &is_useful);
    }
    if (status == BEV_OK && is_useful) {
      room->states = room->bounded_states;
      room->powers_w = room->bounded_powers_w;
      *found = bounded;
      *trajectory = bounded_trajectory;
    }
    soc = room->bounded_states;
    if (status == BEV_OK && bounded_trajectory.states[1][trip->steps] < situation->target_c) {
      aim_c += BEV_MORE_AIM * (situation->target_c - bounded_trajectory.states[1][trip->steps]);
    }
  }
  return status;
}

static bev_status plan_within_limits(const bev_vehicle *vehicle, const bev_trip *trip,
                                     const bev_ecu_situation *situation, merit_room *room,
                                     bev_ecu_plan *plan) {
  const int32_t steps = trip->steps;
  bev_merit_plan found;
  bev_trajectory trajectory;
  double allowed_w = 0.0;
  bev_status status = run_idle(vehicle, trip, situation, room);
  if (status == BEV_OK) {
    status = plan_useful(vehicle, trip, situation, room, &found, &trajectory);
  }
  if (status == BEV_OK) {
    status = bev_deficit_w(vehicle, trip, &trajectory, &plan->deficit_w);
  }
  if (status == BEV_OK) {
    status = find_allowed(vehicle, trip, room, &allowed_w);
  }
  if (status != BEV_OK) {
    return status;
  }
  if (found.stranding.step >= 0 || plan->deficit_w > allowed_w) {
    return BEV_LIMITED;
  }
  plan->soc = room->states;
  plan->temperature_c = &room->states[steps + 1];
  plan->heater_w = room->powers_w;
  plan->brake_w = &room->powers_w[steps];
  if (!isnan(found.start_s)) {
    bev_ecu_tell_instants(trip, plan->heater_w, found.start_s,
                          isnan(found.end_s) ? trip->time_s[steps] : found.end_s, plan);
  }
  if (room->rows == 2) {
    plan->off_s = NAN;
  }
  return keep_accounts(vehicle, trip, room, plan);
}

bev_status bev_ecu_plan_merit_order(const bev_vehicle *vehicle, const bev_trip *trip,
                                    const bev_ecu_situation *situation, double *memory,
                                    uint8_t *flags, int32_t *order, bev_ecu_plan *plan) {
  if (memory == NULL || flags == NULL || order == NULL || plan == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  bev_status status = bev_ecu_check(vehicle, trip, situation);
  if (status != BEV_OK) {
    return status;
  }
  merit_room room;
  room.rows = bev_ecu_arrives_late(vehicle) ? 4 : 2;
  room.idle_states = bev_take(&memory, room.rows * (trip->steps + 1));
  room.states = bev_take(&memory, room.rows * (trip->steps + 1));
  room.powers_w = bev_take(&memory, room.rows * trip->steps);
  room.bounded_states = bev_take(&memory, room.rows * (trip->steps + 1));
  room.bounded_powers_w = bev_take(&memory, room.rows * trip->steps);
  room.ceiling_c = bev_take(&memory, trip->steps);
  room.along_c = bev_take(&memory, trip->steps);
  room.work = memory;
  room.watched = flags;
  room.order = order;
  plan->on_s = NAN;
  plan->off_s = NAN;
  status = plan_within_limits(vehicle, trip, situation, &room, plan);
  return status == BEV_OK ? bev_ecu_conclude(trip, situation, plan) : status;
}
