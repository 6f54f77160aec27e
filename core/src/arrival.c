/* SPDX-License-Identifier: Apache-2.0 */
/* How the arrival depends on what is believed: bev_preheat.estimation.forecast, to rounding. */
#include <stddef.h>
#include <string.h>

#include "bev_preheat_core/estimation.h"
#include "bev_preheat_core_generated/drives.h"
#include "checks.h"

int32_t bev_size_of_course(void) { return (int32_t)sizeof(bev_course); }

static int is_course(const bev_course *course) {
  return course->steps >= 1 && course->steps <= BEV_MOST_STEPS && course->duration_s != NULL
      && course->speed_mps != NULL && course->ambient_temperature_c != NULL
      && course->propulsion_power_w != NULL && course->power_variance_w2 != NULL
      && course->propulsion_power_magnitude_w != NULL && course->cabin_heating_power_w != NULL
      && course->auxiliary_power_w != NULL && course->heater_power_w != NULL
      && course->temperature_c != NULL && course->soc != NULL;
}

/* dT/dt [K/s] in step k of a state and factors. */
static double rate_of(const bev_vehicle *vehicle, const bev_course *course, int32_t k,
                      double temperature_c, double soc, const double factor[BEV_FACTORS]) {
  double rates[2];
  bev_rates_on_route(
      vehicle, BEV_AS_ARRAYS, temperature_c, soc, factor[0], factor[1], factor[2], factor[3],
      factor[4], course->speed_mps[k], course->ambient_temperature_c[k],
      course->propulsion_power_w[k], course->power_variance_w2[k],
      course->propulsion_power_magnitude_w[k], course->cabin_heating_power_w[k],
      course->auxiliary_power_w[k], course->heater_power_w[k], course->gamma_0_w_per_k,
      course->gamma_v_w_per_k_per_mps, rates);
  return rates[0];
}

bev_status bev_arrival_sensitivities(const bev_vehicle *vehicle, const bev_course *course,
                                     const bev_belief_terms *terms, double *total, double *by_step) {
  if (vehicle == NULL || course == NULL || terms == NULL || total == NULL || by_step == NULL
      || !is_course(course)) {
    return BEV_BAD_ARGUMENT;
  }
  if (!bev_is_vehicle(vehicle)) {
    return BEV_BAD_VEHICLE;
  }
  const double *const moved_by = terms->perturbation;
  const double nominal[BEV_FACTORS] = {1.0, 1.0, 1.0, 1.0, 1.0};
  double moved[BEV_FACTORS];
  for (int32_t n = 0; n < BEV_FACTORS; n++) {
    moved[n] = exp(moved_by[BEV_HEAT_CAPACITY + n]);
  }
  memset(total, 0, BEV_ELEMENTS * sizeof(double));
  /* What a kelvin at the end of the step is worth on arrival. */
  double worth = 1.0;
  for (int32_t k = course->steps - 1; k >= 0; k--) {
    const double temperature_c = course->temperature_c[k];
    const double soc = course->soc[k];
    const double duration_s = course->duration_s[k];
    const double rate = rate_of(vehicle, course, k, temperature_c, soc, nominal);
    const double by_temperature =
        (rate_of(vehicle, course, k, temperature_c + moved_by[BEV_TEMPERATURE], soc, nominal) - rate)
        / moved_by[BEV_TEMPERATURE] * duration_s;
    const double by_soc =
        (rate_of(vehicle, course, k, temperature_c, soc + moved_by[BEV_SOC], nominal) - rate)
        / moved_by[BEV_SOC] * duration_s;
    total[BEV_SOC] += worth * by_soc;
    double last = 0.0;
    for (int32_t n = 0; n < BEV_FACTORS; n++) {
      double factor[BEV_FACTORS];
      memcpy(factor, nominal, sizeof factor);
      factor[n] = moved[n];
      last = worth
          * ((rate_of(vehicle, course, k, temperature_c, soc, factor) - rate)
             / moved_by[BEV_HEAT_CAPACITY + n] * duration_s);
      total[BEV_HEAT_CAPACITY + n] += last;
    }
    by_step[k] = last;
    worth *= exp(by_temperature);
    if (!isfinite(worth) || !isfinite(last) || !isfinite(by_soc)) {
      return BEV_NOT_FINITE;
    }
  }
  /* What is under way arrives. */
  total[BEV_TEMPERATURE] = worth;
  total[BEV_UNDER_WAY] = worth;
  return BEV_OK;
}
