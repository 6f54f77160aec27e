/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One step within the battery's limits: bev_preheat.planning.limits and bev_preheat.planning.heated_limits.
 *
 * The states of a step are charge, temperature [deg C], heater power [W] and coolant excess [K]. A vehicle whose
 * heat arrives at once has only the first two; the others are 0.
 */
#ifndef BEV_PREHEAT_CORE_LIMITED_STEP_H_
#define BEV_PREHEAT_CORE_LIMITED_STEP_H_

#include "limited_run.h"

bev_limited_run bev_limited_run_of(const bev_vehicle *vehicle, const bev_trip *trip,
                                   const uint8_t *may_overcharge, const uint8_t *may_overdraw,
                                   int32_t takes_surplus, int32_t is_direct);

/*
 * Drive step k from its states, heated with `wanted_w` [W] as far as limits let it.
 *
 * Writes the states at its end, and command, friction brake, heater power and heat into the battery, means [W].
 * BEV_EMPTY: the charge does not last for the step, and only the powers are meaningful.
 */
bev_status bev_drive_within_limits(const bev_limited_run *run, int32_t k, const double states[4],
                                   double wanted_w, double ends[4], double powers_w[4]);

/*
 * Drive the step of `stranding` as far as the charge lasts, and stand from then on. `states` and `powers_w`, of
 * `rows` arrays each, are known until that step, including the powers planned for it.
 */
bev_status bev_strand(const bev_limited_run *run, int32_t rows, double *const states[4],
                      double *const powers_w[4],
                      bev_stranding *stranding);

#endif /* BEV_PREHEAT_CORE_LIMITED_STEP_H_ */
