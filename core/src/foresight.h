/* SPDX-License-Identifier: Apache-2.0 */
/* Command for a lagging heater in view of later steps: bev_preheat.planning.heated_limits. */
#ifndef BEV_PREHEAT_CORE_FORESIGHT_H_
#define BEV_PREHEAT_CORE_FORESIGHT_H_

#include "limited_run.h"

/* The command after which the heater, switched off, leaves a climb its power [W]. */
double bev_off_in_time_w(const bev_limited_run *run, int32_t k, const double states[4]);

/* The part of the surplus that lasts [W]: heater power beyond it is paid for later. */
double bev_lasting_surplus_w(const bev_limited_run *run, int32_t k, const double states[4]);

#endif /* BEV_PREHEAT_CORE_FORESIGHT_H_ */
