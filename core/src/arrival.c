/* SPDX-License-Identifier: Apache-2.0 */
/* Uncertainty of the temperature on arrival: bev_preheat.estimation.forecast, to rounding. */
#include <stddef.h>
#include <string.h>

#include "bev_preheat_core/estimation.h"
#include "bev_preheat_core_generated/drives.h"
#include "checks.h"
#include "curves.h"
#include "route_columns.h"

static int is_expected_drive(const bev_expected_drive *expected) {
  return expected->steps >= 1 && expected->steps <= BEV_MOST_STEPS && expected->route != NULL
      && expected->heater_power_w != NULL && expected->source_heat_w != NULL && expected->temperature_c != NULL && expected->soc != NULL;
}

/* The value of a column of the route in step k. */
static double at(const bev_expected_drive *expected, int32_t column, int32_t k) {
  return expected->route[column * expected->steps + k];
}

/* dT/dt [K/s] in step k of a state and factors. */
static double rate_of(const bev_vehicle *vehicle, const bev_expected_drive *expected, int32_t k,
                      const bev_circuit *of, const double factor[BEV_FACTORS]) {
  const double power_w = at(expected, BEV_ROUTE_PROPULSION, k);
  double rates[3];
  bev_rates_on_route(
      vehicle, BEV_AS_ARRAYS, of->voltage_v, of->resistance_ohm, of->temperature_c, factor[0], factor[1], factor[2], factor[3],
      factor[4], factor[5], at(expected, BEV_ROUTE_SPEED, k), at(expected, BEV_ROUTE_AMBIENT, k), power_w,
      bev_power_variance_w2(at(expected, BEV_ROUTE_RMS, k), power_w),
      at(expected, BEV_ROUTE_MAGNITUDE, k), at(expected, BEV_ROUTE_CABIN, k),
      at(expected, BEV_ROUTE_AUXILIARY, k), expected->heater_power_w[k], expected->source_heat_w[k], expected->gamma_0_w_per_k,
      expected->gamma_v_w_per_k_per_mps, rates);
  return rates[0];
}

/* Variance of the arrival due to traffic in a step [K^2]; `by_power_k`: sensitivity to the log of its power [K]. */
static double traffic_k2(const bev_expected_drive *expected, const bev_belief_terms *terms, int32_t k,
                         double by_power_k) {
  /* If a step drives and regenerates about equally, its mean power is small but its heat is not. */
  const double magnitude_w = bev_maximum(at(expected, BEV_ROUTE_MAGNITUDE, k), 1.0);
  const double deviation_k =
      by_power_k * (terms->power_noise * bev_maximum(1.0, terms->least_power_w / magnitude_w));
  return deviation_k * deviation_k
      * bev_maximum(1.0, terms->power_noise_lasts_s / at(expected, BEV_ROUTE_DURATION, k));
}

/* Sensitivity of the arrival to each element at the start, and its variance due to traffic [K^2]. */
static bev_status find_sensitivities(const bev_vehicle *vehicle, const bev_expected_drive *expected,
                                     const bev_belief_terms *terms, double total[BEV_ELEMENTS],
                                     double *by_traffic_k2) {
  const double *const moved_by = terms->perturbation;
  const double nominal[BEV_FACTORS] = {1.0, 1.0, 1.0, 1.0, 1.0, 1.0};
  double moved[BEV_FACTORS];
  for (int32_t n = 0; n < BEV_FACTORS; n++) {
    moved[n] = exp(moved_by[BEV_HEAT_CAPACITY + n]);
  }
  memset(total, 0, BEV_ELEMENTS * sizeof(double));
  *by_traffic_k2 = 0.0;
  /* Kelvins on arrival per kelvin at the end of the step. */
  double worth = 1.0;
  for (int32_t k = expected->steps - 1; k >= 0; k--) {
    const double temperature_c = expected->temperature_c[k];
    const double soc = expected->soc[k];
    const double duration_s = at(expected, BEV_ROUTE_DURATION, k);
    const bev_circuit here = bev_circuit_at(vehicle, soc, temperature_c);
    const bev_circuit warmer = bev_circuit_at(vehicle, soc, temperature_c + moved_by[BEV_TEMPERATURE]);
    const bev_circuit fuller = bev_circuit_at(vehicle, soc + moved_by[BEV_SOC], temperature_c);
    const double rate = rate_of(vehicle, expected, k, &here, nominal);
    const double by_temperature = (rate_of(vehicle, expected, k, &warmer, nominal) - rate)
        / moved_by[BEV_TEMPERATURE] * duration_s;
    const double by_soc = (rate_of(vehicle, expected, k, &fuller, nominal) - rate)
        / moved_by[BEV_SOC] * duration_s;
    total[BEV_SOC] += worth * by_soc;
    double by_power = 0.0;
    for (int32_t n = 0; n < BEV_FACTORS; n++) {
      double factor[BEV_FACTORS];
      memcpy(factor, nominal, sizeof factor);
      factor[n] = moved[n];
      const double by_factor = worth
          * ((rate_of(vehicle, expected, k, &here, factor) - rate)
             / moved_by[BEV_HEAT_CAPACITY + n] * duration_s);
      total[BEV_HEAT_CAPACITY + n] += by_factor;
      by_power = BEV_HEAT_CAPACITY + n == BEV_PROPULSION ? by_factor : by_power;
    }
    *by_traffic_k2 += traffic_k2(expected, terms, k, by_power);
    worth *= exp(by_temperature);
    if (!isfinite(worth) || !isfinite(by_power) || !isfinite(by_soc)) {
      return BEV_NOT_FINITE;
    }
  }
  /* Heat under way arrives. */
  total[BEV_TEMPERATURE] = worth;
  total[BEV_UNDER_WAY] = worth;
  return BEV_OK;
}

bev_status bev_arrival_variance(const bev_vehicle *vehicle, const bev_expected_drive *expected,
                                const bev_belief_terms *terms, const double *covariance, double *variance_k2) {
  if (vehicle == NULL || expected == NULL || terms == NULL || covariance == NULL
      || variance_k2 == NULL || !is_expected_drive(expected)) {
    return BEV_BAD_ARGUMENT;
  }
  if (!bev_is_vehicle(vehicle)) {
    return BEV_BAD_VEHICLE;
  }
  double total[BEV_ELEMENTS];
  double by_traffic_k2 = 0.0;
  const bev_status status = find_sensitivities(vehicle, expected, terms, total, &by_traffic_k2);
  if (status != BEV_OK) {
    return status;
  }
  double believed_k2 = 0.0;
  for (int32_t i = 0; i < BEV_ELEMENTS; i++) {
    double row = 0.0;
    for (int32_t j = 0; j < BEV_ELEMENTS; j++) {
      row += covariance[i * BEV_ELEMENTS + j] * total[j];
    }
    believed_k2 += total[i] * row;
  }
  *variance_k2 = bev_maximum(0.0, believed_k2) + by_traffic_k2;
  return isfinite(believed_k2) && isfinite(*variance_k2) ? BEV_OK : BEV_NOT_FINITE;
}
