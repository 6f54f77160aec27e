/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The interface of the exported planner: one function for each method. A program that calls only one function links
 * only the code which that function needs.
 *
 * bev_ecu_plan_switch, the method optimal_switch: one heating interval, for trips on which no limit of the
 * battery is active. It needs the least memory.
 *
 * bev_ecu_plan_by_values, the method value_function: heating where a kelvin is worth more than it costs, within the
 * limits if one is active.
 *
 * Both return BEV_LIMITED and no plan if no plan is better than not heating: the caller then keeps the heater off, or
 * follows its current plan.
 *
 * Units: seconds, watts, kelvin, degrees Celsius (names that end in _c), states of charge 0 ... 1,
 * energies in Wh. bev_trip, bev_vehicle and the status codes are those of bev_preheat_core/core.h.
 *
 * The functions allocate no memory and retain no state between calls; vehicle and trip are only read. They may be
 * called from several tasks at once, each with memory of its own.
 */
#ifndef BEV_ECU_H_
#define BEV_ECU_H_

#include "bev_preheat_core/core.h"

/* Memory of bev_ecu_plan_switch for a trip of `steps` steps [doubles]; the first is enough without a heat path. */
#define BEV_ECU_DIRECT_MEMORY(steps) (7 * (steps) + 4)
#define BEV_ECU_MEMORY(steps) (13 * (steps) + 8 + BEV_TWO_SWITCHES_MEMORY(steps))

/* Memory of bev_ecu_plan_by_values: doubles, and bytes. */
#define BEV_ECU_VALUE_MEMORY(steps)                                                                 \
  (9 * (steps) + 4                                                                                  \
   + (BEV_VALUE_SPARING_MEMORY(steps) > BEV_ECU_MEMORY(steps) ? BEV_VALUE_SPARING_MEMORY(steps)     \
                                                              : BEV_ECU_MEMORY(steps)))
#define BEV_ECU_VALUE_BYTES(steps)                                                                  \
  (BEV_VALUE_BYTES(steps) > 2 * (steps) ? BEV_VALUE_BYTES(steps) : 2 * (steps))

/* The state at the start of a trip, and the requirements on arrival. */
typedef struct {
  /* 0 ... 1 */
  double soc;
  /* Of the battery, within its range, lowest_c ... highest_c of the vehicle. */
  double temperature_c;
  /* Heater power, and excess of the coolant temperature over the battery's; 0 without a heat path. */
  double heater_w;
  double coolant_excess_k;
  /* Wanted on arrival, within the battery's range. */
  double target_c;
  /* State of charge that must be left on arrival, and on the way: 0 ... 1. */
  double reserve_soc;
  double least_soc;
} bev_ecu_situation;

/* A plan. Its arrays lie in the caller's memory. */
typedef struct {
  /*
   * optimal_switch: the heater takes all power that the cabin leaves from `on_s` until `off_s`, seconds after the
   * start of the trip. `on_s` is NaN without heating, `off_s` if heating lasts until arrival: always without a heat
   * path. `off_s` is never within steps in which the cabin leaves no power, but before them.
   *
   * value_function: the first and, with a heat path, the last instant of heating; `heater_w` has the powers between
   * them: there may be several intervals, and any power.
   */
  double on_s;
  double off_s;
  double arrival_c;
  double arrival_soc;
  /* Least state of charge on the way. */
  double least_soc;
  /* Shortfall from the target in spite of heating all the way [K]; 0 if the target is reached. */
  double shortfall_k;
  /*
   * The worst power deficit of the battery [W], or 0: at most 10 W more than without paid heating. In a deficit the
   * vehicle drives with the most power that the battery gives.
   */
  double deficit_w;
  /* As in bev_energies, including the energy that a lagging heater takes after arrival. */
  bev_energies energy_wh;
  /* At each instant, steps + 1 values. */
  const double *soc;
  const double *temperature_c;
  /* Heater command in each step [W], mean. */
  const double *heater_w;
  /* Regeneration power taken by the friction brake in each step [W], mean; null: 0 in all steps. */
  const double *brake_w;
} bev_ecu_plan;

/*
 * The plan of a trip. BEV_OK: `plan` is written. Any other status: there is no plan, and `plan` is undefined.
 *
 *   BEV_LIMITED (4)        there is no plan that is better than not heating, see below
 *   BEV_BAD_ARGUMENT (-1)  a pointer is null, or the trip has no steps or more than BEV_MOST_STEPS
 *   BEV_BAD_VEHICLE (-2)   a number of the vehicle is not finite or impossible
 *   BEV_BAD_INPUT (-3)     a number of trip or situation is not finite or out of its range
 *   BEV_NOT_FINITE (-4)    the model yields no finite number
 *   BEV_NOT_SETTLED (-5)   a search did not end within its maximum number of rounds
 *
 * Ranges of the trip, beyond being finite: time_s rises, by duration_s; power_variance_w2,
 * leakage_w_per_k and heater_limit_w are 0 or more.
 */

/*
 * BEV_LIMITED: a limit of the battery is active, with or without heating, or the plan does not leave the required
 * charge.
 * `memory` has BEV_ECU_MEMORY(steps) doubles.
 */
bev_status bev_ecu_plan_switch(const bev_vehicle *vehicle, const bev_trip *trip,
                               const bev_ecu_situation *situation, double *memory,
                               bev_ecu_plan *plan);

/*
 * BEV_LIMITED: the plan leaves less of the required charge than the trip without paid heating, or has a greater power
 * deficit, or the charge does not last for the trip. `memory` has BEV_ECU_VALUE_MEMORY(steps) doubles, `flags` has
 * BEV_ECU_VALUE_BYTES(steps) bytes.
 */
bev_status bev_ecu_plan_by_values(const bev_vehicle *vehicle, const bev_trip *trip,
                                  const bev_ecu_situation *situation, double *memory,
                                  uint8_t *flags, bev_ecu_plan *plan);

#endif /* BEV_ECU_H_ */
