/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The method value_function: bev_preheat.planning.methods, and the check whether its plan may be used: no
 * plan may be worse than not heating (bev_preheat.planning.outcome).
 */
#include "bev_ecu_shared.h"

#include <math.h>
#include <stddef.h>

#include "bev_preheat_core_generated/constants.h"
#include "limited_run.h"
#include "parts_of_plans.h"

/* A heat path or not, runs have four rows here. */
#define ROWS 4

/* Memory of the plan: that of one heating interval, the powers of a run within limits, and flags of its steps. */
typedef struct {
  bev_ecu_room interval;
  double *powers_w;
  uint8_t *flags;
} values_room;

/* Bounds of a plan, from the trip without paid heating: the least spare charge, the largest power deficit [W]. */
typedef struct {
  double spare_soc;
  double deficit_w;
} demands;

/* The run within limits under the commands of `room`; BEV_LIMITED if the charge runs out. */
static bev_status drive(const bev_vehicle *vehicle, const bev_trip *trip,
                        const bev_ecu_situation *situation, const values_room *room,
                        int32_t takes_surplus) {
  bev_stranding stranding;
  bev_ecu_start(vehicle, trip, situation, room->interval.states);
  const bev_status status =
      bev_drive_as_planned(vehicle, trip, room->interval.command_w, HUGE_VAL, takes_surplus,
                           room->interval.states, room->powers_w, room->flags, &stranding);
  return status == BEV_OK && stranding.step >= 0 ? BEV_LIMITED : status;
}

/* The worst power deficit of a driven run [W]; 0 if it is rounding. */
static bev_status find_deficit(const bev_vehicle *vehicle, const bev_trip *trip,
                               const values_room *room, double *deficit_w) {
  const int32_t steps = trip->steps;
  const double *const states = room->interval.states;
  const double *const most_w = room->interval.most_w;
  const double *const drawn_w =
      &room->powers_w[bev_is_direct(vehicle) != 0 ? 0 : 2 * steps];
  const bev_status status =
      bev_limits_of_steps(vehicle, steps, states, &states[steps + 1], trip->power_variance_w2,
                          room->interval.least_w, room->interval.most_w);
  double rounding_w = 0.0;
  *deficit_w = 0.0;
  for (int32_t k = 0; status == BEV_OK && k < steps; k++) {
    const double lacking_w = trip->idle_power_w[k] + drawn_w[k] - most_w[k];
    if (lacking_w > *deficit_w) {
      *deficit_w = lacking_w;
      rounding_w = BEV_POWER_TOLERANCE * fabs(trip->idle_power_w[k]);
    }
  }
  if (*deficit_w <= rounding_w) {
    *deficit_w = 0.0;
  }
  return status;
}

static void command_nothing(const values_room *room, int32_t steps) {
  for (int32_t k = 0; k < steps; k++) {
    room->interval.command_w[k] = 0.0;
  }
}

/* The trip without paid heating; BEV_LIMITED if the charge runs out. */
static bev_status find_demands(const bev_vehicle *vehicle, const bev_trip *trip,
                               const bev_ecu_situation *situation, const values_room *room,
                               demands *asked) {
  const double *unheated = room->interval.idle_states;
  bev_status status = bev_ecu_run_idle(vehicle, trip, situation, &room->interval);
  asked->deficit_w = 0.0;
  if (status == BEV_LIMITED) {
    /* Within limits it takes free heat: surplus that the friction brake would waste. */
    unheated = room->interval.states;
    command_nothing(room, trip->steps);
    status = drive(vehicle, trip, situation, room, 1);
    if (status == BEV_OK) {
      status = find_deficit(vehicle, trip, room, &asked->deficit_w);
    }
    if (asked->deficit_w > 0.0) {
      asked->deficit_w += BEV_NO_WORSE_W;
    }
  }
  if (status == BEV_OK) {
    const double spare_soc = bev_ecu_spare_soc(trip, situation, unheated);
    asked->spare_soc = spare_soc < 0.0 ? spare_soc : 0.0;
  }
  return status;
}

/* The plan with one heating interval, if none is better: else BEV_LIMITED, or BEV_CHEAPER_ELSEWHERE. */
static bev_status plan_interval(const bev_vehicle *vehicle, const bev_trip *trip,
                                const bev_ecu_situation *situation, const values_room *room,
                                bev_ecu_plan *plan) {
  bev_status status =
      bev_ecu_plan_interval(vehicle, trip, situation, &room->interval, plan);
  if (status == BEV_OK) {
    status = bev_ecu_conclude(trip, situation, 0.0, plan);
  }
  return status != BEV_OK || bev_is_direct(vehicle) == 0
      ? status
      : bev_costs_least(vehicle, trip, plan->soc, plan->temperature_c, plan->heater_w);
}

/* The instants of heating of a driven run: a step that is heated in part is heated evenly. */
static void tell_instants(const bev_vehicle *vehicle, const bev_trip *trip, bev_ecu_plan *plan) {
  int32_t first = trip->steps;
  int32_t end = 0;
  for (int32_t k = trip->steps - 1; k >= 0; k--) {
    if (bev_is_heated(trip, plan->heater_w, k) != 0) {
      first = k;
      end = end > k ? end : k + 1;
    }
  }
  if (first < trip->steps) {
    bev_ecu_tell_instants(vehicle, trip, plan->heater_w, trip->time_s[first], trip->time_s[end],
                          plan);
  }
}

/* The plan within limits, and the check that it is no worse than not heating. */
static bev_status plan_within_limits(const bev_vehicle *vehicle, const bev_trip *trip,
                                     const bev_ecu_situation *situation, const values_room *room,
                                     const demands *asked, bev_ecu_plan *plan) {
  const int32_t steps = trip->steps;
  double *const states = room->interval.states;
  const double reserve = situation->reserve_soc;
  const bev_value_goal goal = {situation->heater_w > BEV_LEAST_HEATING_W ? 1 : 0,
                               situation->target_c, INFINITY, reserve > 0.0 ? reserve + BEV_SPARE_SOC : 0.0,
                               0.0, NULL};
  int32_t ends_in = -1;
  bev_ecu_start(vehicle, trip, situation, states);
  /* The recursion works where the unheated run was. */
  bev_status status = bev_plan_by_values(vehicle, trip, &goal, states, room->powers_w,
                                         room->flags, room->interval.idle_states, &ends_in,
                                         BEV_VALUE_KEPT_EVERY);
  const int32_t is_empty = status == BEV_EMPTY ? 1 : 0;
  if (status != BEV_OK && is_empty == 0) {
    return status;
  }
  command_nothing(room, steps);
  for (int32_t k = 0; k < steps && is_empty == 0; k++) {
    room->interval.command_w[k] = room->powers_w[k];
  }
  status = drive(vehicle, trip, situation, room, is_empty);
  if (status == BEV_OK) {
    status = find_deficit(vehicle, trip, room, &plan->deficit_w);
  }
  if (status == BEV_OK && plan->deficit_w > asked->deficit_w) {
    status = BEV_LIMITED;
  }
  if (status != BEV_OK) {
    return status;
  }
  plan->soc = states;
  plan->temperature_c = &states[steps + 1];
  plan->heater_w = room->powers_w;
  plan->brake_w = &room->powers_w[steps];
  tell_instants(vehicle, trip, plan);
  status = bev_ecu_keep_accounts(vehicle, trip, &room->powers_w[2 * steps], plan);
  return status == BEV_OK ? bev_ecu_conclude(trip, situation, asked->spare_soc, plan) : status;
}

bev_status bev_ecu_plan_by_values(const bev_vehicle *vehicle, const bev_trip *trip,
                                  const bev_ecu_situation *situation, double *memory,
                                  uint8_t *flags, bev_ecu_plan *plan) {
  if (memory == NULL || flags == NULL || plan == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  bev_status status = bev_ecu_check(vehicle, trip, situation);
  if (status != BEV_OK) {
    return status;
  }
  const int32_t steps = trip->steps;
  values_room room;
  room.interval = bev_ecu_room_in(&memory[ROWS * steps], steps, ROWS);
  room.powers_w = memory;
  room.flags = flags;
  demands asked = {0.0, 0.0};
  bev_ecu_begin(plan);
  status = find_demands(vehicle, trip, situation, &room, &asked);
  if (status != BEV_OK) {
    return status;
  }
  status = plan_interval(vehicle, trip, situation, &room, plan);
  if (status == BEV_LIMITED || status == BEV_CHEAPER_ELSEWHERE) {
    bev_ecu_begin(plan);
    status = plan_within_limits(vehicle, trip, situation, &room, &asked, plan);
  }
  return status;
}
