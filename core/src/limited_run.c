/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The forward run that keeps the battery's limits, and its end where the charge runs out:
 * bev_preheat.planning.limited_drive.
 */
#include "limited_run.h"

#include "bev_preheat_core_generated/constants.h"
#include "checks.h"

/* The run up to the step in which the charge runs out, and the powers planned for that step. */
typedef struct {
  const bev_limited_run *run;
  double command_w;
  double brake_w;
  /* Of heat sources that draw another power than the HVCH for the same heat. */
  double other_w;
} last_drive;

/* Drive a share of a step: `result` is as of the model's step. */
static bev_status drive_share(const last_drive *drive, int32_t k, double share, const double states[4],
                              double result[8]) {
  const bev_vehicle *vehicle = drive->run->vehicle;
  const bev_trip *trip = drive->run->trip;
  bev_inputs inputs = bev_inputs_of(vehicle, trip, k, NULL, NULL);
  if (!bev_are_finite(&inputs) || !isfinite(trip->drivetrain_heat_w[k])) {
    return BEV_BAD_INPUT;
  }
  inputs.power_w = share * inputs.power_w;
  inputs.variance_w2 = share * inputs.variance_w2;
  inputs.heat_w = inputs.heat_w - (1.0 - share) * trip->drivetrain_heat_w[k];
  if (drive->run->is_direct != 0) {
    inputs.power_w = inputs.power_w + share * (drive->command_w + drive->other_w + drive->brake_w);
    inputs.heat_w = inputs.heat_w
        + share * bev_heat_under_w(vehicle, 0.0, drive->command_w, drive->brake_w);
    bev_integrate(vehicle, BEV_RUNGE_KUTTA_4, 1, states[0], states[1], &inputs, result);
    result[2] = 0.0;
    result[3] = 0.0;
    result[6] = share * drive->command_w;
    result[7] = bev_heat_with_heater_w(vehicle, 0.0, result[6]);
    result[6] += share * drive->other_w;
  } else {
    const double started[4] = {states[0], states[1], share * states[2], states[3]};
    inputs.power_w = inputs.power_w + share * (drive->brake_w + drive->other_w);
    inputs.heat_w = inputs.heat_w - share * vehicle->heat_share * drive->brake_w;
    bev_integrate_heated(vehicle, 1, started, &inputs, share * drive->command_w, result);
    result[6] += share * drive->other_w;
  }
  return bev_kind_of(result[0], result[1]) == BEV_OK && bev_kind_of(result[2], result[3]) == BEV_OK
      ? BEV_OK
      : BEV_NOT_FINITE;
}

/*
 * Drive the step of `stranding` as far as the charge lasts, and stand from then on. `states` and `powers_w`, of
 * `rows` arrays each, are known until that step, including the powers planned for it.
 */
static bev_status strand(const bev_limited_run *run, int32_t rows, double *const states[4],
                         double *const powers_w[4], bev_stranding *stranding) {
  const int32_t steps = run->trip->steps;
  const int32_t empty = stranding->step;
  const double other_w =
      run->trip->sources == NULL ? 0.0 : powers_w[2][empty] - powers_w[0][empty];
  const last_drive drive = {run, powers_w[0][empty], powers_w[1][empty], other_w};
  double here[4] = {0.0, 0.0, 0.0, 0.0};
  double result[8];
  for (int32_t n = 0; n < rows; n++) {
    here[n] = states[n][empty];
  }
  double enough = 0.0;
  double too_little = 1.0;
  for (int32_t n = 0; n < BEV_HALVINGS; n++) {
    const double middle = 0.5 * (enough + too_little);
    const bev_status status = drive_share(&drive, empty, middle, here, result);
    if (status != BEV_OK) {
      return status;
    }
    if (result[0] > 0.0) {
      enough = middle;
    } else {
      too_little = middle;
    }
  }
  stranding->driven_share = enough;
  for (int32_t k = empty; k < steps; k++) {
    const double share = k == empty ? enough : 0.0;
    const bev_status status = drive_share(&drive, k, share, here, result);
    if (status != BEV_OK) {
      return status;
    }
    const double powers[4] = {share * drive.command_w, share * drive.brake_w, result[6],
                              result[7]};
    here[0] = 0.0;
    here[1] = bev_minimum(result[1], run->vehicle->hottest_c);
    here[2] = 0.0;
    here[3] = result[3];
    for (int32_t n = 0; n < rows; n++) {
      states[n][k + 1] = here[n];
      powers_w[n][k] = powers[n];
    }
  }
  return BEV_OK;
}

/* Drive the whole run; `states` and `powers_w` are `rows` arrays each. */
static bev_status drive_run(const bev_limited_run *run, const double *command_w, double below_c, int32_t rows,
                            double *const states[4], double *const powers_w[4], bev_stranding *stranding) {
  double here[4] = {0.0, 0.0, 0.0, 0.0};
  for (int32_t n = 0; n < rows; n++) {
    here[n] = states[n][0];
    if (!isfinite(here[n])) {
      return BEV_BAD_INPUT;
    }
  }
  for (int32_t k = 0; k < run->trip->steps; k++) {
    double driven_w[4];
    const double wanted_w =
        command_w[k] < 0.0 || bev_settled_c(run, here) < below_c ? command_w[k] : 0.0;
    const bev_status status = bev_drive_within_limits(run, k, here, wanted_w, here, driven_w);
    if (status != BEV_OK && status != BEV_EMPTY) {
      return status;
    }
    for (int32_t n = 0; n < rows; n++) {
      powers_w[n][k] = driven_w[n];
    }
    if (status == BEV_EMPTY) {
      stranding->step = k;
      return strand(run, rows, states, powers_w, stranding);
    }
    for (int32_t n = 0; n < rows; n++) {
      states[n][k + 1] = here[n];
    }
  }
  return BEV_OK;
}

bev_status bev_drive_as_planned(const bev_vehicle *vehicle, const bev_trip *trip, const double *command_w,
                                double below_c, int32_t takes_surplus, double *states, double *powers_w,
                                uint8_t *flags, bev_stranding *stranding) {
  const bev_status checked = bev_checked(vehicle, trip, 0);
  if (checked != BEV_OK) {
    return checked;
  }
  if (command_w == NULL || isnan(below_c) != 0 || states == NULL || powers_w == NULL
      || flags == NULL || stranding == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  const int32_t steps = trip->steps;
  const int32_t is_direct = bev_is_direct(vehicle);
  const int32_t rows = is_direct != 0 && trip->sources == NULL ? 2 : 4;
  double *all_states[4] = {NULL, NULL, NULL, NULL};
  double *all_powers_w[4] = {NULL, NULL, NULL, NULL};
  for (int32_t n = 0; n < rows; n++) {
    all_states[n] = &states[n * (steps + 1)];
    all_powers_w[n] = &powers_w[n * steps];
  }
  for (int32_t k = 0; k < steps; k++) {
    flags[k] = trip->propulsion_power_w[k] < 0.0 ? 1u : 0u;
    flags[steps + k] = 1u;
  }
  const bev_limited_run run =
      bev_limited_run_of(vehicle, trip, flags, &flags[steps], takes_surplus, is_direct);
  stranding->step = -1;
  stranding->driven_share = 1.0;
  return drive_run(&run, command_w, below_c, rows, all_states, all_powers_w, stranding);
}
