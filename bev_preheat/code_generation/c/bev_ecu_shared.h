/* SPDX-License-Identifier: Apache-2.0 */
/* Code shared by both methods: the checks of their inputs, one heating interval, and the report on a run. */
#ifndef BEV_ECU_SHARED_H_
#define BEV_ECU_SHARED_H_

#include "bev_ecu.h"

/* Arrays for a plan with one heating interval, in the caller's memory; from `idle_states` on they lie there one after another. */
typedef struct {
  double *states;
  double *command_w;
  double *idle_states;
  /* The battery's limits in each step. */
  double *least_w;
  double *most_w;
  /* With a heat path: heater power and arriving heat, two arrays. */
  double *heat_w;
  double *search;
} bev_ecu_room;

/* The arrays for runs of `rows` rows: charge and temperature; with 4, for a heat path, heater power and coolant. */
bev_ecu_room bev_ecu_room_in(double *memory, int32_t steps, int32_t rows);

/* BEV_OK if each number of vehicle, trip and situation is valid. */
bev_status bev_ecu_check(const bev_vehicle *vehicle, const bev_trip *trip,
                         const bev_ecu_situation *situation);

/* A plan without heating and without a power deficit; its arrays are not set. */
void bev_ecu_begin(bev_ecu_plan *plan);

/* Write the state at the start of a trip into a run. */
void bev_ecu_start(const bev_vehicle *vehicle, const bev_trip *trip,
                   const bev_ecu_situation *situation, double *states);

/* The run without heating, ignoring limits; BEV_LIMITED if it does not keep them. */
bev_status bev_ecu_run_idle(const bev_vehicle *vehicle, const bev_trip *trip,
                            const bev_ecu_situation *situation, const bev_ecu_room *room);

/* The plan with one heating interval from that run on; BEV_LIMITED if it does not keep the limits. */
bev_status bev_ecu_plan_interval(const bev_vehicle *vehicle, const bev_trip *trip,
                                 const bev_ecu_situation *situation, const bev_ecu_room *room,
                                 bev_ecu_plan *plan);

/*
 * Write the heating instants to the plan, from commands [W]; `off_s` is the instant of switching off, or the arrival.
 * While the cabin takes all heater power, the battery is not heated: heating then ends before those steps.
 */
void bev_ecu_tell_instants(const bev_vehicle *vehicle, const bev_trip *trip,
                           const double *command_w, double on_s, double off_s,
                           bev_ecu_plan *plan);

/*
 * Write the energies of the planned run. `heat_w` are the heater's power and the arriving heat of a heat path; without
 * one the heater draws the command.
 */
bev_status bev_ecu_keep_accounts(const bev_vehicle *vehicle, const bev_trip *trip,
                                 const double *heat_w, bev_ecu_plan *plan);

/* Charge of a run beyond the required one, on arrival or on the way, whichever is less. */
double bev_ecu_spare_soc(const bev_trip *trip, const bev_ecu_situation *situation,
                         const double *soc);

/* Report on the planned run; BEV_LIMITED if it has less charge to spare than `spare_soc`. */
bev_status bev_ecu_conclude(const bev_trip *trip, const bev_ecu_situation *situation,
                            double spare_soc, bev_ecu_plan *plan);

#endif /* BEV_ECU_SHARED_H_ */
