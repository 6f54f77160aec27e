/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Limits and charge along a run: the functions of the same names in
 * bev_preheat.planning.limits, no_regret and charge_acceptance.
 */
#include "trajectory.h"

#include "bev_preheat_core_generated/constants.h"
#include <stdbool.h>

#include "step_limits.h"

#define SECONDS_PER_HOUR 3600.0

static bev_status limits_at(const bev_vehicle *vehicle, double soc, double temperature_c,
                            double variance_w2, double limits_w[2]) {
  bev_terminal_limits(vehicle, BEV_AS_ARRAYS, soc, temperature_c, variance_w2, limits_w);
  return isfinite(limits_w[0]) && isfinite(limits_w[1]) ? BEV_OK : BEV_NOT_FINITE;
}

bev_status bev_watch_limits(const bev_vehicle *vehicle, const bev_trip *trip,
                            const bev_trajectory *trajectory, bev_watch *watch) {
  double least_w[BEV_LIMITS_BLOCK];
  double most_w[BEV_LIMITS_BLOCK];
  for (int32_t from = 0; from < trip->steps; from += BEV_LIMITS_BLOCK) {
    const int32_t count =
        trip->steps - from < BEV_LIMITS_BLOCK ? trip->steps - from : BEV_LIMITS_BLOCK;
    const bev_status status = bev_limits_of_block(
        vehicle, count, &trajectory->states[0][from], &trajectory->states[1][from], BEV_COLDER_BY_K,
        &trip->power_variance_w2[from], least_w, most_w);
    if (status != BEV_OK) {
      return status;
    }
    for (int32_t n = 0; n < count; n++) {
      const int32_t k = from + n;
      const double power_w = trip->idle_power_w[k];
      watch->charge[k] =
          trip->propulsion_power_w[k] < 0.0 && power_w < least_w[n] ? 1u : 0u;
      watch->discharge[k] = power_w + trip->heater_limit_w[k] > most_w[n] ? 1u : 0u;
    }
  }
  return BEV_OK;
}

bev_status bev_deficit_w(const bev_vehicle *vehicle, const bev_trip *trip,
                         const bev_trajectory *trajectory, double *worst_w) {
  /* With a heat path the mean heater power is the third row of powers. */
  const double *drawn_w = trajectory->powers_w[trajectory->rows == 2 ? 0 : 2];
  double worst_at_w = 0.0;
  double least_w[BEV_LIMITS_BLOCK];
  double most_w[BEV_LIMITS_BLOCK];
  /* A stranded vehicle has a charge deficit, not a power deficit. */
  const int32_t driven = trajectory->stranding.step < 0 ? trip->steps : trajectory->stranding.step;
  *worst_w = 0.0;
  for (int32_t from = 0; from < driven; from += BEV_LIMITS_BLOCK) {
    const int32_t count = driven - from < BEV_LIMITS_BLOCK ? driven - from : BEV_LIMITS_BLOCK;
    const bev_status status = bev_limits_of_block(
        vehicle, count, &trajectory->states[0][from], &trajectory->states[1][from], 0.0,
        &trip->power_variance_w2[from], least_w, most_w);
    if (status != BEV_OK) {
      return status;
    }
    for (int32_t n = 0; n < count; n++) {
      const double deficit_w = trip->idle_power_w[from + n] + drawn_w[from + n] - most_w[n];
      if (deficit_w > *worst_w) {
        *worst_w = deficit_w;
        worst_at_w = trip->idle_power_w[from + n];
      }
    }
  }
  if (*worst_w <= BEV_POWER_TOLERANCE * fabs(worst_at_w)) {
    *worst_w = 0.0;
  }
  return BEV_OK;
}

bev_status bev_blend_acceptance_loss(const bev_vehicle *vehicle, const bev_trip *trip,
                                     const bev_watch *watch, const bev_trajectory *trajectory,
                                     bev_acceptance_loss *loss, int32_t *any) {
  const double capacity_as = SECONDS_PER_HOUR * vehicle->capacity_ah;
  *any = 0;
  for (int32_t k = 0; k < trip->steps; k++) {
    double lost = 0.0;
    double surplus_w = 0.0;
    if (watch->charge[k] != 0u) {
      const double soc = trajectory->states[0][k];
      const double temperature_c = trajectory->states[1][k];
      const double variance_w2 = trip->power_variance_w2[k];
      double limits_w[2];
      double fuller_w[2];
      bev_status status = limits_at(vehicle, soc, temperature_c, variance_w2, limits_w);
      if (status == BEV_OK) {
        status =
            limits_at(vehicle, soc + BEV_ACCEPTANCE_SOC_DIFFERENCE, temperature_c, variance_w2, fuller_w);
      }
      if (status != BEV_OK) {
        return status;
      }
      surplus_w = limits_w[0] - trip->idle_power_w[k];
      if (surplus_w > 0.0) {
        const double voltage_v =
            bev_at(&vehicle->open_circuit_voltage, BEV_AS_ARRAYS, soc, temperature_c);
        lost = bev_minimum(
            bev_maximum(trip->duration_s[k] * (fuller_w[0] - limits_w[0])
                            / (BEV_ACCEPTANCE_SOC_DIFFERENCE * capacity_as * voltage_v),
                        0.0),
            1.0);
      }
    }
    const bool is_braked = surplus_w >= trip->heater_limit_w[k];
    loss->to_brake[k] = 0.5 * (loss->to_brake[k] + (is_braked ? lost : 0.0));
    loss->to_heater[k] = 0.5 * (loss->to_heater[k] + (is_braked ? 0.0 : lost));
    if (!isfinite(loss->to_brake[k]) || !isfinite(loss->to_heater[k])) {
      return BEV_NOT_FINITE;
    }
    if (loss->to_brake[k] != 0.0 || loss->to_heater[k] != 0.0) {
      *any = 1;
    }
  }
  return BEV_OK;
}
