/* SPDX-License-Identifier: Apache-2.0 */
/* Cost of a kelvin on arrival in each step: bev_preheat.planning.one_interval. */
#include "parts_of_plans.h"

#include "bev_preheat_core_generated/constants.h"
#include "slopes.h"

/*
 * Upper bound of the charge that heating elsewhere can save, as far as the prices do not change. The run is heated
 * from one instant on; each cheaper step is compared with the dearest heated step.
 */
static bev_status find_most_saving(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                                   const double *temperature_c, const double *heater_w, double *saving) {
  /* Value on arrival of charge and warmth at the end of a step, in warmth and in charge. */
  bev_charge_warmth in_warmth = {0.0, 1.0};
  bev_charge_warmth in_charge = {1.0, 0.0};
  double dearest_per_k = -INFINITY;
  *saving = 0.0;
  for (int32_t k = trip->steps - 1; k >= 0; k--) {
    const bev_middle middle = bev_middle_of(vehicle, trip, soc, temperature_c, heater_w[k], 0.0, k);
    if (!bev_is_middle(&middle)) {
      return BEV_BAD_INPUT;
    }
    const bev_slopes slopes = bev_slopes_of_model(&middle);
    const bev_charge_warmth warmth_before = bev_worth_before(in_warmth, &slopes);
    const bev_charge_warmth charge_before = bev_worth_before(in_charge, &slopes);
    /* Effect on arrival of a watt of the heater. */
    const double warmth_k_per_w = bev_effect(in_warmth, warmth_before, slopes.by_power);
    const double charge_per_w = -bev_effect(in_charge, charge_before, slopes.by_power);
    in_warmth = warmth_before;
    in_charge = charge_before;
    if (warmth_k_per_w > 0.0) {
      const double per_k = charge_per_w / warmth_k_per_w;
      const double unheated_w = trip->heater_limit_w[k] - heater_w[k];
      if (unheated_w > 0.0 && per_k < dearest_per_k) {
        *saving += (dearest_per_k - per_k) * warmth_k_per_w * unheated_w;
      }
      if (heater_w[k] > 0.0) {
        dearest_per_k = bev_maximum(dearest_per_k, per_k);
      }
    }
  }
  return BEV_OK;
}

bev_status bev_costs_least(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                           const double *temperature_c, const double *heater_w) {
  const int32_t steps = trip->steps;
  double saving = 0.0;
  const bev_status status =
      find_most_saving(vehicle, trip, soc, temperature_c, heater_w, &saving);
  if (status != BEV_OK) {
    return status;
  }
  const double whole_wh = vehicle->capacity_ah
      * bev_at(&vehicle->open_circuit_voltage, BEV_EXACT, soc[steps], temperature_c[steps]);
  return saving < BEV_LEAST_SAVING_WH / whole_wh ? BEV_OK : BEV_CHEAPER_ELSEWHERE;
}
