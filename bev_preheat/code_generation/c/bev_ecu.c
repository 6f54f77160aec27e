/* SPDX-License-Identifier: Apache-2.0 */
/* Code shared by both methods: the checks of their inputs, and the report on a run. */
#include "bev_ecu_shared.h"

#include <math.h>
#include <stddef.h>

#include "bev_preheat_core_generated/constants.h"
#include "limited_run.h"

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

void bev_ecu_begin(bev_ecu_plan *plan) {
  plan->on_s = NAN;
  plan->off_s = NAN;
  plan->deficit_w = 0.0;
  plan->brake_w = NULL;
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

void bev_ecu_tell_instants(const bev_vehicle *vehicle, const bev_trip *trip,
                           const double *command_w, double on_s, double off_s,
                           bev_ecu_plan *plan) {
  const double end_s = heated_until_s(trip, off_s);
  for (int32_t k = 0; k < trip->steps; k++) {
    if (command_w[k] != 0.0) {
      plan->on_s = on_s;
      if (bev_is_direct(vehicle) == 0 && end_s < trip->time_s[trip->steps]) {
        plan->off_s = end_s;
      }
      return;
    }
  }
}

bev_status bev_ecu_keep_accounts(const bev_vehicle *vehicle, const bev_trip *trip,
                                 const double *heat_w, bev_ecu_plan *plan) {
  const int32_t steps = trip->steps;
  const int32_t is_direct = bev_is_direct(vehicle);
  /* The circuit's own limit lies at the battery's or above it, so without a deficit all power is deliverable. */
  const bev_run_of_powers made = {plan->deficit_w == 0.0 ? 1 : 0,
                                  plan->soc,
                                  plan->temperature_c,
                                  is_direct != 0 ? plan->heater_w : heat_w,
                                  is_direct != 0 ? NULL : &heat_w[steps],
                                  plan->brake_w};
  const bev_status status =
      bev_keep_accounts(vehicle, BEV_RUNGE_KUTTA_4, trip, &made, NULL, &plan->energy_wh);
  if (vehicle->shell_share > 0.0) {
    /* Heat arrives in the shell, which is warmer than the core and leaks. */
    const double *excess_k = &plan->soc[3 * (steps + 1)];
    plan->energy_wh.hvch_heat = vehicle->heater_efficiency * plan->energy_wh.hvch_electric;
    for (int32_t k = 0; k < steps; k++) {
      plan->energy_wh.leakage -= trip->leakage_w_per_k[k] * 0.5 * (excess_k[k] + excess_k[k + 1])
          * trip->duration_s[k] / BEV_JOULES_PER_WH;
    }
  }
  if (is_direct == 0) {
    const double heater_w = plan->soc[2 * (steps + 1) + steps];
    const double after_wh = vehicle->heater_lag_s * heater_w / BEV_JOULES_PER_WH;
    plan->energy_wh.hvch_electric += after_wh;
    plan->energy_wh.battery_total += after_wh;
  }
  return status;
}

static double least_value(const double *values, int32_t count) {
  double least = values[0];
  for (int32_t n = 1; n < count; n++) {
    least = values[n] < least ? values[n] : least;
  }
  return least;
}

double bev_ecu_spare_soc(const bev_trip *trip, const bev_ecu_situation *situation,
                         const double *soc) {
  const double on_arrival = soc[trip->steps] - situation->reserve_soc;
  const double on_the_way = least_value(soc, trip->steps + 1) - situation->least_soc;
  return on_arrival < on_the_way ? on_arrival : on_the_way;
}

bev_status bev_ecu_conclude(const bev_trip *trip, const bev_ecu_situation *situation,
                            double spare_soc, bev_ecu_plan *plan) {
  const double deficit_k = situation->target_c - plan->temperature_c[trip->steps];
  plan->arrival_c = plan->temperature_c[trip->steps];
  plan->arrival_soc = plan->soc[trip->steps];
  plan->shortfall_k = deficit_k > 0.0 ? deficit_k : 0.0;
  plan->least_soc = least_value(plan->soc, trip->steps + 1);
  return bev_ecu_spare_soc(trip, situation, plan->soc) >= spare_soc ? BEV_OK : BEV_LIMITED;
}
