/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What comes of a run: its energies, and its stretches of heating, as bev_preheat.planning.heating_intervals tells
 * them, where the reasons stand.
 */
#include "bev_preheat_core_generated/constants.h"
#include "checks.h"
#include "limited_step.h"
#include "step_limits.h"

/* A step that is not heated, or that gives no reason for heating before it. */
#define NOTHING (-1)
#define ARRIVAL 0
#define SURPLUS 1
#define DESCENT 2
#define CLIMB 3

/* A run that is told in stretches. */
typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  const double *soc;
  const double *temperature_c;
  const double *command_w;
  const double *least_w;
} told_run;

/* Whether a step is heated for the arrival, or with surplus, or not at all. */
static int32_t kind_of(const told_run *run, int32_t k) {
  const bev_trip *trip = run->trip;
  const double heater_w = run->command_w[k];
  if (!(heater_w > BEV_HEATING_SHARE * trip->heater_limit_w[k])) {
    return NOTHING;
  }
  return trip->propulsion_power_w[k] < 0.0
          && heater_w <= run->least_w[k] - trip->idle_power_w[k] + BEV_SURPLUS_TOLERANCE_W
      ? SURPLUS
      : ARRIVAL;
}

/* The reason that a step gives for heating before it: what a colder battery would not allow. */
static bev_status find_event(const told_run *run, int32_t k, int32_t *event) {
  const bev_trip *trip = run->trip;
  double limits_w[2];
  const bev_status status =
      bev_limits_of_colder_step(run->vehicle, &run->soc[k], &run->temperature_c[k],
                                trip->power_variance_w2[k], limits_w);
  *event = NOTHING;
  if (trip->propulsion_power_w[k] < 0.0 && trip->idle_power_w[k] < limits_w[0]) {
    *event = DESCENT;
  }
  if (trip->idle_power_w[k] > limits_w[1]) {
    *event = CLIMB;
  }
  return status;
}

/* The step from which on nothing is heated: where heat would come too late, before arrival. */
static int32_t too_late_from(const told_run *run, int32_t may_end_early) {
  const bev_trip *trip = run->trip;
  int32_t last = trip->steps;
  while (last > 0 && kind_of(run, last - 1) == NOTHING) {
    last--;
  }
  const double left_s = trip->time_s[trip->steps] - trip->time_s[last];
  return may_end_early != 0 && left_s <= BEV_TOO_LATE_LAGS * bev_heat_lag_s(run->vehicle)
      ? last
      : trip->steps;
}

/* The heated steps in stretches, each of one kind. */
static int32_t divide(const told_run *run, bev_stretch *stretches) {
  const bev_trip *trip = run->trip;
  int32_t count = 0;
  int32_t kind_before = NOTHING;
  for (int32_t k = 0; k < trip->steps; k++) {
    const int32_t kind = kind_of(run, k);
    if (kind != NOTHING) {
      if (kind != kind_before) {
        const bev_stretch begun = {k, k, kind, 0.0};
        stretches[count] = begun;
        count++;
      }
      stretches[count - 1].last = k + 1;
      stretches[count - 1].energy_wh +=
          run->command_w[k] * trip->duration_s[k] / BEV_JOULES_PER_WH;
    }
    kind_before = kind;
  }
  return count;
}

/* What paid heating that ends early is for: the first thing behind it. */
static bev_status find_reasons(const told_run *run, int32_t too_late, bev_stretch *stretches,
                               int32_t count) {
  const int32_t steps = run->trip->steps;
  /* The last step that was looked at, and what it gives a reason for. */
  int32_t at = -1;
  int32_t event = NOTHING;
  for (int32_t n = 0; n < count; n++) {
    const int32_t last = stretches[n].last;
    if (stretches[n].reason == ARRIVAL && last < too_late) {
      if (at < last) {
        event = NOTHING;
        at = last - 1;
      }
      while (event == NOTHING && at + 1 < steps) {
        at++;
        const bev_status status = find_event(run, at, &event);
        if (status != BEV_OK) {
          return status;
        }
      }
      stretches[n].reason = event == NOTHING ? ARRIVAL : event;
    }
  }
  return BEV_OK;
}

bev_status bev_find_outcome(const bev_vehicle *vehicle, int32_t integrator, const bev_trip *trip,
                            const bev_run_of_powers *run, const double *command_w,
                            const double *least_w, int32_t may_end_early, bev_energies *energies,
                            bev_stretch *stretches, int32_t *count) {
  if (command_w == NULL || least_w == NULL || stretches == NULL || count == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  const bev_status status =
      bev_keep_accounts(vehicle, integrator, trip, run, NULL, energies);
  if (status != BEV_OK) {
    return status;
  }
  const told_run told = {vehicle, trip, run->soc, run->temperature_c, command_w, least_w};
  *count = divide(&told, stretches);
  return find_reasons(&told, too_late_from(&told, may_end_early), stretches, *count);
}
