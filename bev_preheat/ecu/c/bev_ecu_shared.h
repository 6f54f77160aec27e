/* SPDX-License-Identifier: Apache-2.0 */
/* What both methods share: the checks of their inputs, and what is told of a run. */
#ifndef BEV_ECU_SHARED_H_
#define BEV_ECU_SHARED_H_

#include "bev_ecu.h"

/* BEV_OK if each number of vehicle, trip and situation can be one. */
bev_status bev_ecu_check(const bev_vehicle *vehicle, const bev_trip *trip,
                         const bev_ecu_situation *situation);

/* Whether the vehicle has a heat path. */
int bev_ecu_arrives_late(const bev_vehicle *vehicle);

/*
 * Tell when it is heated, from commands [W]; `off_s` is the instant of switching off, or the arrival. Where the
 * cabin takes all of the heater nothing is heated, and it ends before that.
 */
void bev_ecu_tell_instants(const bev_trip *trip, const double *command_w, double on_s,
                           double off_s, bev_ecu_plan *plan);

/* Tell of the run that is planned; BEV_LIMITED where it does not leave the charge it must. */
bev_status bev_ecu_conclude(const bev_trip *trip, const bev_ecu_situation *situation,
                            bev_ecu_plan *plan);

#endif /* BEV_ECU_SHARED_H_ */
