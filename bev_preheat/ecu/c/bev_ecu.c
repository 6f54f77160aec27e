/* SPDX-License-Identifier: Apache-2.0 */
/* Code shared by both methods: the checks of their inputs, and the report on a run. */
#include "bev_ecu_shared.h"

#include <math.h>
#include <stddef.h>

/* Instants and durations of a trip agree to this [s], for rounding. */
#define TIME_TOLERANCE_S 1e-6

static int is_between(double value, double low, double high) {
  return value >= low && value <= high;
}

static int is_not_negative(double value) { return isfinite(value) && value >= 0.0; }

static int is_trip(const bev_trip *trip) {
  return trip->steps >= 1 && trip->steps <= BEV_MOST_STEPS && trip->time_s != NULL
      && trip->duration_s != NULL && trip->idle_power_w != NULL && trip->power_variance_w2 != NULL
      && trip->idle_heat_w != NULL && trip->leakage_w_per_k != NULL && trip->heater_limit_w != NULL
      && trip->propulsion_power_w != NULL && trip->drivetrain_heat_w != NULL
      && trip->ambient_temperature_c != NULL;
}

/* BEV_OK if each number of a trip is valid. */
static bev_status check_steps(const bev_trip *trip) {
  if (!isfinite(trip->time_s[0])) {
    return BEV_BAD_INPUT;
  }
  for (int32_t k = 0; k < trip->steps; k++) {
    const double difference_s = trip->time_s[k + 1] - trip->time_s[k] - trip->duration_s[k];
    if (!isfinite(trip->duration_s[k]) || !(trip->duration_s[k] > 0.0)
        || !(fabs(difference_s) <= TIME_TOLERANCE_S) || !isfinite(trip->idle_power_w[k])
        || !is_not_negative(trip->power_variance_w2[k]) || !isfinite(trip->idle_heat_w[k])
        || !is_not_negative(trip->leakage_w_per_k[k]) || !is_not_negative(trip->heater_limit_w[k])
        || !isfinite(trip->propulsion_power_w[k]) || !isfinite(trip->drivetrain_heat_w[k])
        || !isfinite(trip->ambient_temperature_c[k])) {
      return BEV_BAD_INPUT;
    }
  }
  return BEV_OK;
}

static bev_status check_situation(const bev_vehicle *vehicle, const bev_ecu_situation *situation) {
  return is_between(situation->soc, 0.0, 1.0)
          && is_between(situation->temperature_c, vehicle->lowest_c, vehicle->highest_c)
          && is_between(situation->target_c, vehicle->lowest_c, vehicle->highest_c)
          && is_not_negative(situation->heater_w) && isfinite(situation->coolant_excess_k)
          && is_between(situation->reserve_soc, 0.0, 1.0)
          && is_between(situation->least_soc, 0.0, 1.0)
      ? BEV_OK
      : BEV_BAD_INPUT;
}

bev_status bev_ecu_check(const bev_vehicle *vehicle, const bev_trip *trip,
                         const bev_ecu_situation *situation) {
  if (vehicle == NULL || trip == NULL || situation == NULL || !is_trip(trip)) {
    return BEV_BAD_ARGUMENT;
  }
  bev_status status = bev_check_vehicle(vehicle);
  if (status == BEV_OK) {
    status = check_steps(trip);
  }
  if (status == BEV_OK) {
    status = check_situation(vehicle, situation);
  }
  return status;
}

int bev_ecu_arrives_late(const bev_vehicle *vehicle) {
  return vehicle->heater_lag_s > 0.0 || vehicle->coolant_heat_capacity_j_per_k > 0.0;
}

/* The last instant of heating before `off_s`: the battery is not heated while the cabin takes all power. */
static double heated_until_s(const bev_trip *trip, double off_s) {
  for (int32_t k = trip->steps - 1; k >= 0; k--) {
    if (trip->heater_limit_w[k] > 0.0 && trip->time_s[k] < off_s) {
      return off_s < trip->time_s[k + 1] ? off_s : trip->time_s[k + 1];
    }
  }
  return off_s;
}

void bev_ecu_tell_instants(const bev_trip *trip, const double *command_w, double on_s,
                           double off_s, bev_ecu_plan *plan) {
  const double end_s = heated_until_s(trip, off_s);
  for (int32_t k = 0; k < trip->steps; k++) {
    if (command_w[k] != 0.0) {
      plan->on_s = on_s;
      plan->off_s = end_s < trip->time_s[trip->steps] ? end_s : NAN;
      return;
    }
  }
}

bev_status bev_ecu_conclude(const bev_trip *trip, const bev_ecu_situation *situation,
                            bev_ecu_plan *plan) {
  const double deficit_k = situation->target_c - plan->temperature_c[trip->steps];
  plan->arrival_c = plan->temperature_c[trip->steps];
  plan->arrival_soc = plan->soc[trip->steps];
  plan->shortfall_k = deficit_k > 0.0 ? deficit_k : 0.0;
  plan->least_soc = plan->soc[0];
  for (int32_t k = 1; k <= trip->steps; k++) {
    if (plan->soc[k] < plan->least_soc) {
      plan->least_soc = plan->soc[k];
    }
  }
  return plan->arrival_soc >= situation->reserve_soc && plan->least_soc >= situation->least_soc
      ? BEV_OK
      : BEV_LIMITED;
}
