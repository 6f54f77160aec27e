/* SPDX-License-Identifier: Apache-2.0 */
/* Code shared by both methods: the checks of their inputs, and the report on a run. */
#ifndef BEV_ECU_SHARED_H_
#define BEV_ECU_SHARED_H_

#include "bev_ecu.h"

/* BEV_OK if each number of vehicle, trip and situation is valid. */
bev_status bev_ecu_check(const bev_vehicle *vehicle, const bev_trip *trip,
                         const bev_ecu_situation *situation);

/* Whether the vehicle has a heat path. */
int bev_ecu_arrives_late(const bev_vehicle *vehicle);

/*
 * Write the heating instants to the plan, from commands [W]; `off_s` is the instant of switching off, or the arrival.
 * While the cabin takes all heater power, the battery is not heated: heating then ends before those steps.
 */
void bev_ecu_tell_instants(const bev_trip *trip, const double *command_w, double on_s,
                           double off_s, bev_ecu_plan *plan);

/* Report on the planned run; BEV_LIMITED if it does not leave the required charge. */
bev_status bev_ecu_conclude(const bev_trip *trip, const bev_ecu_situation *situation,
                            bev_ecu_plan *plan);

#endif /* BEV_ECU_SHARED_H_ */
