/* SPDX-License-Identifier: Apache-2.0 */
/* Runs and searches, the parts of plans. Arguments, memory and statuses are as in core.h. */
#ifndef BEV_PREHEAT_CORE_PARTS_OF_PLANS_H_
#define BEV_PREHEAT_CORE_PARTS_OF_PLANS_H_

#include "bev_preheat_core/core.h"

/*
 * Heating in a run within limits: each step that begins colder than `below_c` [deg C] is heated with its `power_w`
 * [W]. Arrays over the steps.
 */
typedef struct {
  /* Regeneration beyond the charge limit goes to the heater first, then to the brake. */
  int32_t takes_surplus;
  double below_c;
  const double *power_w;
  /* Steps in which the charge limit, and the discharge limit, may be active: not 0. */
  const uint8_t *may_overcharge;
  const uint8_t *may_overdraw;
} bev_heating;

/*
 * Heater and coolant in the steps of a run: `heat_w` is two arrays of `steps` values, one after the other, the
 * means of the heater's power and of the heat that reaches the battery [W]. `states` are as in bev_run_heated.
 */
bev_status bev_heat_along(const bev_vehicle *vehicle, const bev_trip *trip, const double *states,
                          const double *command_w, double *heat_w);

/*
 * The instant [s] at which a run backward from the target, heated with all power that the cabin leaves, meets the
 * unheated run. The backward run ends `lost_k` above the target.
 */
bev_status bev_find_crossing(const bev_vehicle *vehicle, int32_t integrator, const bev_trip *trip,
                             double target_c, double terminal_soc, double lost_k,
                             const double *idle_temperature_c, double *instant_s);

/*
 * A run within the battery's limits, from step `first` on; heat arrives at once.
 *
 * soc[first] and temperature_c[first] are the start; the states after it are written, and the powers of heater and
 * friction brake in each step [W]. If the status is BEV_EMPTY, the charge runs out in step `empty_step`, whose
 * powers are the last that are written.
 */
bev_status bev_run_within_limits(const bev_vehicle *vehicle, const bev_trip *trip,
                                 const bev_heating *heating, int32_t first, double *soc,
                                 double *temperature_c, double *heater_w, double *brake_w,
                                 int32_t *empty_step);

/*
 * The same with the heat path: `states` as in bev_run_heated, `powers_w` four arrays of `steps` values, one after
 * the other: means of command, friction brake, heater power, and heat into the battery [W].
 */
bev_status bev_run_heated_within_limits(const bev_vehicle *vehicle, const bev_trip *trip,
                                        const bev_heating *heating, int32_t first, double *states,
                                        double *powers_w, int32_t *empty_step);

/*
 * The end of a run within limits whose charge runs out in the step of `stranding`. The share of the step that is
 * driven is written, and the states after it, at which the vehicle stands. `states` are two arrays of steps + 1
 * values, charge and temperature, `powers_w` two of `steps`, heater and friction brake; with a heat path both are as
 * in bev_run_heated_within_limits. They are given up to this step, with the step's intended powers.
 */
bev_status bev_stand(const bev_vehicle *vehicle, const bev_trip *trip, double *states,
                     double *powers_w, bev_stranding *stranding);

/*
 * The switch-on instant [s] from which the heater takes all power that the cabin leaves, so that the battery
 * arrives at a target; heat arrives at once, limits are ignored. 0 if that is not enough.
 *
 * `idle_soc` and `idle_c` are the unheated run, which arrives below the target. The run, its start included, and
 * the heater's power in each step [W] are written.
 */
bev_status bev_find_switch(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                           const double *idle_soc, const double *idle_c, double *soc,
                           double *temperature_c, double *heater_w, double *instant_s);

#endif /* BEV_PREHEAT_CORE_PARTS_OF_PLANS_H_ */
