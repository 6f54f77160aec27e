/* SPDX-License-Identifier: Apache-2.0 */
/* The filters of bev_preheat.estimation.belief, in the order of its operations, to rounding. */
#include <float.h>
#include <stddef.h>
#include <string.h>

#include "bev_preheat_core/estimation.h"
#include "bev_preheat_core_generated/constants.h"
#include "bev_preheat_core_generated/drives.h"
#include "checks.h"
#include "curves.h"

#define SQUARE (BEV_ELEMENTS * BEV_ELEMENTS)

/* The elements that move with time; all others wander. */
#define MOVING 5
static const int32_t MOVED[MOVING] = {BEV_TEMPERATURE, BEV_SOC, BEV_UNDER_WAY, BEV_SENSOR, BEV_LOCAL};
/* Temperature and charge change at rates, which come with the Joule heat. */
#define RATES 3

static int is_belief(const bev_belief *belief) {
  return belief != NULL && belief->heaters >= 1 && belief->heaters <= BEV_MOST_HEATERS
      && belief->noises >= 1 && belief->noises <= BEV_MOST_NOISES && belief->weights != NULL
      && belief->mean != NULL && belief->covariance != NULL && belief->memory != NULL;
}

/* Mean and covariance of a mixture of every `apart`th filter from `first` on. */
static void blend(const bev_belief *belief, int32_t first, int32_t apart, int32_t count, const double *share,
                  double *mean, double *covariance) {
  memset(mean, 0, BEV_ELEMENTS * sizeof(double));
  memset(covariance, 0, SQUARE * sizeof(double));
  for (int32_t n = 0; n < count; n++) {
    const double *const own = &belief->mean[(first + n * apart) * BEV_ELEMENTS];
    for (int32_t i = 0; i < BEV_ELEMENTS && share[n] != 0.0; i++) {
      mean[i] += share[n] * own[i];
    }
  }
  for (int32_t n = 0; n < count; n++) {
    const double *const own = &belief->mean[(first + n * apart) * BEV_ELEMENTS];
    const double *const spread = &belief->covariance[(first + n * apart) * SQUARE];
    for (int32_t i = 0; i < BEV_ELEMENTS && share[n] != 0.0; i++) {
      for (int32_t j = 0; j < BEV_ELEMENTS; j++) {
        covariance[i * BEV_ELEMENTS + j] += share[n]
            * (spread[i * BEV_ELEMENTS + j] + (own[i] - mean[i]) * (own[j] - mean[j]));
      }
    }
  }
}

static bev_status mix_belief(const bev_belief *belief, const double *transitions) {
  const int32_t heaters = belief->heaters;
  const int32_t noises = belief->noises;
  const int32_t filters = heaters * noises;
  double *const weights = belief->memory;
  double *const means = &weights[filters];
  double *const covariances = &means[filters * BEV_ELEMENTS];
  for (int32_t to = 0; to < heaters; to++) {
    for (int32_t noise = 0; noise < noises; noise++) {
      const int32_t at = to * noises + noise;
      double share[BEV_MOST_HEATERS];
      double total = 0.0;
      for (int32_t from = 0; from < heaters; from++) {
        share[from] = transitions[from * heaters + to] * belief->weights[from * noises + noise];
        total += share[from];
      }
      if (!isfinite(total) || !(total > 0.0)) {
        return BEV_NOT_FINITE;
      }
      weights[at] = total;
      for (int32_t from = 0; from < heaters; from++) {
        share[from] /= total;
      }
      blend(belief, noise, noises, heaters, share, &means[at * BEV_ELEMENTS], &covariances[at * SQUARE]);
    }
  }
  memcpy(belief->weights, weights, (size_t)filters * sizeof(double));
  memcpy(belief->mean, means, (size_t)(filters * BEV_ELEMENTS) * sizeof(double));
  memcpy(belief->covariance, covariances, (size_t)(filters * SQUARE) * sizeof(double));
  return BEV_OK;
}

static void rates_of(const bev_vehicle *vehicle, const bev_drive *drive, double heater_w, double source_heat_w,
                     const bev_circuit *at, const double factor[BEV_FACTORS], double rates[RATES]) {
  if (drive->is_seen) {
    bev_rates_of_seen_power(
        vehicle, BEV_AS_ARRAYS, at->voltage_v, at->resistance_ohm, at->temperature_c, factor[0], factor[1], factor[2], factor[3],
        factor[4], factor[5], drive->speed_mps, drive->ambient_temperature_c, drive->propulsion_power_w,
        drive->power_variance_w2, drive->propulsion_power_magnitude_w,
        drive->cabin_heating_power_w, drive->auxiliary_power_w, heater_w, source_heat_w, drive->terminal_power_w,
        drive->hidden_variance_w2, drive->gamma_0_w_per_k, drive->gamma_v_w_per_k_per_mps, rates);
  } else {
    bev_rates_on_route(
        vehicle, BEV_AS_ARRAYS, at->voltage_v, at->resistance_ohm, at->temperature_c, factor[0], factor[1], factor[2], factor[3],
        factor[4], factor[5], drive->speed_mps, drive->ambient_temperature_c, drive->propulsion_power_w,
        drive->power_variance_w2, drive->propulsion_power_magnitude_w,
        drive->cabin_heating_power_w, drive->auxiliary_power_w, heater_w, source_heat_w, drive->gamma_0_w_per_k,
        drive->gamma_v_w_per_k_per_mps, rates);
  }
}

/* The lags of a state [s], and the remainders of lagging values after a step. */
typedef struct {
  double heat_s;
  double sensor_s;
  double heat_left;
  double sensor_left;
  double local_left;
} lags;

/* Compute the lags that depend on element `moved` of a state; -1: all. */
static void find_lags(const bev_belief_terms *terms, const double state[BEV_ELEMENTS], double duration_s,
                      int32_t moved, lags *of) {
  if (moved < 0 || moved == BEV_HEAT_LAG) {
    of->heat_s = terms->nominal_heat_lag_s * exp(state[BEV_HEAT_LAG]);
    of->heat_left = exp(-duration_s / of->heat_s);
  }
  if (moved < 0 || moved == BEV_SENSOR_LAG) {
    of->sensor_s = terms->nominal_sensor_lag_s * exp(state[BEV_SENSOR_LAG]);
    of->sensor_left = exp(-duration_s / of->sensor_s);
  }
  if (moved < 0) {
    of->local_left = exp(-duration_s / terms->local_lag_s);
  }
}

/* Temperature of the shell above the core's [K]; see bev_preheat.estimation.estimate. */
static double shell_excess_k(const bev_belief_terms *terms, const double state[BEV_ELEMENTS]) {
  const double place = state[BEV_SENSOR_PLACE];
  if (terms->shell_share > 0.0) {
    return state[BEV_UNDER_WAY] / terms->shell_share;
  }
  const double heat_s = terms->nominal_heat_lag_s * exp(state[BEV_HEAT_LAG]);
  const double in_battery = bev_maximum(1.0 - terms->outside_lag_s / (1.0 + bev_maximum(place, 0.0)) / heat_s, 0.0);
  return bev_maximum(place, terms->unseen_shell_rise * in_battery) * state[BEV_UNDER_WAY];
}

/* The state after a step, and its slope over each element; returns whether all are finite. */
static int moved_with_slopes(const bev_vehicle *vehicle, const bev_belief_terms *terms, const bev_drive *drive,
                             double duration_s, double heater_w, double source_heat_w,
                             const double state[BEV_ELEMENTS], double after[MOVING],
                             double slopes[MOVING][BEV_ELEMENTS]) {
  double factor[BEV_FACTORS];
  for (int32_t n = 0; n < BEV_FACTORS; n++) {
    factor[n] = exp(state[BEV_HEAT_CAPACITY + n]);
  }
  const bev_circuit here = bev_circuit_at(vehicle, state[BEV_SOC], state[BEV_TEMPERATURE]);
  double rates[RATES];
  rates_of(vehicle, drive, heater_w, source_heat_w, &here, factor, rates);
  lags lagging;
  find_lags(terms, state, duration_s, -1, &lagging);
  double x[BEV_ELEMENTS];
  memcpy(x, state, sizeof x);
  int is_finite = 1;
  /* First unchanged, then moved along each element. */
  for (int32_t along = -1; along < BEV_ELEMENTS; along++) {
    double own_rates[RATES] = {rates[0], rates[1], rates[2]};
    lags own = lagging;
    double heat_capacity = factor[0];
    if (along >= 0) {
      x[along] = state[along] + terms->perturbation[along];
    }
    if (along >= 0 && along <= BEV_SOURCE_HEAT) {
      double moved[BEV_FACTORS];
      memcpy(moved, factor, sizeof moved);
      if (along >= BEV_HEAT_CAPACITY) {
        moved[along - BEV_HEAT_CAPACITY] = exp(x[along]);
      }
      const bev_circuit there = along < BEV_HEAT_CAPACITY
          ? bev_circuit_at(vehicle, x[BEV_SOC], x[BEV_TEMPERATURE])
          : here;
      rates_of(vehicle, drive, heater_w, source_heat_w, &there, moved, own_rates);
      heat_capacity = moved[0];
    }
    if (along >= 0) {
      find_lags(terms, x, duration_s, along, &own);
    }
    double end[MOVING];
    bev_lagging_step(
        vehicle, BEV_AS_ARRAYS, x[BEV_TEMPERATURE], x[BEV_SOC], x[BEV_UNDER_WAY], x[BEV_SENSOR],
        x[BEV_LOCAL], own.heat_s, own.sensor_s, own.heat_left, own.sensor_left, own.local_left,
        x[BEV_JOULE_RISE], x[BEV_SENSOR_PLACE], own_rates[0], own_rates[1], own_rates[2], heat_capacity,
        duration_s, end);
    for (int32_t m = 0; m < MOVING; m++) {
      if (along < 0) {
        after[m] = end[m];
      } else {
        slopes[m][along] = (end[m] - after[m]) / terms->perturbation[along];
      }
      is_finite = is_finite && isfinite(end[m]);
    }
    if (along >= 0) {
      x[along] = state[along];
    }
  }
  return is_finite;
}

/*
 * Carry a covariance P along: F P F', where F is the identity but for the rows that move. As P is
 * symmetric, the columns of F P that move are its rows.
 */
static void carry_along(double slopes[MOVING][BEV_ELEMENTS], double *covariance) {
  double rows[MOVING][BEV_ELEMENTS];
  double block[MOVING][MOVING];
  for (int32_t m = 0; m < MOVING; m++) {
    for (int32_t j = 0; j < BEV_ELEMENTS; j++) {
      rows[m][j] = 0.0;
    }
    for (int32_t k = 0; k < BEV_ELEMENTS; k++) {
      for (int32_t j = 0; j < BEV_ELEMENTS; j++) {
        rows[m][j] += slopes[m][k] * covariance[k * BEV_ELEMENTS + j];
      }
    }
  }
  for (int32_t m = 0; m < MOVING; m++) {
    for (int32_t n = 0; n < MOVING; n++) {
      block[m][n] = 0.0;
      for (int32_t k = 0; k < BEV_ELEMENTS; k++) {
        block[m][n] += rows[m][k] * slopes[n][k];
      }
    }
  }
  for (int32_t m = 0; m < MOVING; m++) {
    for (int32_t j = 0; j < BEV_ELEMENTS; j++) {
      covariance[MOVED[m] * BEV_ELEMENTS + j] = rows[m][j];
      covariance[j * BEV_ELEMENTS + MOVED[m]] = rows[m][j];
    }
  }
  for (int32_t m = 0; m < MOVING; m++) {
    for (int32_t n = 0; n < MOVING; n++) {
      covariance[MOVED[m] * BEV_ELEMENTS + MOVED[n]] = n < m ? block[n][m] : block[m][n];
    }
  }
}

static bev_status move_belief(const bev_vehicle *vehicle, const bev_belief *belief, const bev_belief_terms *terms,
                              const bev_passed *passed) {
  const double duration_s = passed->duration_s;
  if (!isfinite(duration_s) || !(duration_s > 0.0) || !isfinite(passed->hidden_variance_s2)) {
    return BEV_BAD_INPUT;
  }
  const int32_t filters = belief->heaters * belief->noises;
  const double left = exp(-duration_s / terms->local_lag_s);
  const double rise_noise_k2 = terms->joule_rise_noise_k_per_kw * terms->joule_rise_noise_k_per_kw
      * (1.0 + left) / (1.0 - left);
  double *const means = belief->memory;
  double *const covariances = &means[filters * BEV_ELEMENTS];
  memcpy(means, belief->mean, (size_t)(filters * BEV_ELEMENTS) * sizeof(double));
  memcpy(covariances, belief->covariance, (size_t)(filters * SQUARE) * sizeof(double));
  /* Means over all hypotheses: none is likelier because it expects less noise. */
  double rose2 = 0.0;
  double hidden[BEV_SOC + 1][BEV_SOC + 1] = {{0.0, 0.0}, {0.0, 0.0}};
  for (int32_t filter = 0; filter < filters; filter++) {
    double *const mean = &means[filter * BEV_ELEMENTS];
    double *const covariance = &covariances[filter * SQUARE];
    double after[MOVING] = {0.0, 0.0, 0.0, 0.0, 0.0};
    double slopes[MOVING][BEV_ELEMENTS];
    /* Heat leaks from the shell, as it would from the core in colder air. */
    bev_drive drive = passed->drive;
    drive.ambient_temperature_c -= shell_excess_k(terms, mean);
    if (!moved_with_slopes(vehicle, terms, &drive, duration_s,
                           passed->heater_power_w[filter / belief->noises],
                           passed->source_heat_w[filter / belief->noises], mean, after, slopes)) {
      return BEV_NOT_FINITE;
    }
    for (int32_t m = 0; m < MOVING; m++) {
      mean[MOVED[m]] = after[m];
    }
    carry_along(slopes, covariance);
    for (int32_t i = 0; i < BEV_ELEMENTS; i++) {
      covariance[i * BEV_ELEMENTS + i] += passed->wander[i];
    }
    /* The slope of the local rise over the steady rise gives the Joule heat. */
    const double rose = slopes[MOVING - 1][BEV_JOULE_RISE];
    rose2 += belief->weights[filter] * (rose * rose);
    /* Temperature and state of charge come first. */
    for (int32_t i = 0; i <= BEV_SOC; i++) {
      for (int32_t j = 0; j <= BEV_SOC; j++) {
        hidden[i][j] += belief->weights[filter] * passed->hidden_variance_s2
            * (slopes[i][BEV_PROPULSION] / duration_s) * (slopes[j][BEV_PROPULSION] / duration_s);
      }
    }
  }
  for (int32_t filter = 0; filter < filters; filter++) {
    double *const covariance = &covariances[filter * SQUARE];
    covariance[BEV_LOCAL * BEV_ELEMENTS + BEV_LOCAL] += rise_noise_k2 * rose2;
    for (int32_t i = 0; i <= BEV_SOC; i++) {
      for (int32_t j = 0; j <= BEV_SOC; j++) {
        covariance[i * BEV_ELEMENTS + j] += hidden[i][j];
      }
    }
  }
  memcpy(belief->mean, means, (size_t)(filters * BEV_ELEMENTS) * sizeof(double));
  memcpy(belief->covariance, covariances, (size_t)(filters * SQUARE) * sizeof(double));
  return BEV_OK;
}

/* Kalman update of a filter: mean shifted by gain * shift, covariance reduced by gain * gain' * kept. */
static void update(double *mean, double *covariance, const double gain[BEV_ELEMENTS], double shift, double kept) {
  for (int32_t i = 0; i < BEV_ELEMENTS; i++) {
    mean[i] += gain[i] * shift;
    for (int32_t j = 0; j < BEV_ELEMENTS; j++) {
      covariance[i * BEV_ELEMENTS + j] -= gain[i] * gain[j] * kept;
    }
  }
}

/* Clip the bounded elements; return whether the filter has diverged beyond meaningful values. */
static int32_t hold(const bev_belief_terms *terms, double *mean) {
  for (int32_t n = 0; n < BEV_BOUNDED; n++) {
    double *const value = &mean[BEV_HEAT_CAPACITY + n];
    *value = bev_maximum(bev_minimum(*value, terms->highest[n]), terms->lowest[n]);
  }
  return fabs(mean[BEV_TEMPERATURE] - mean[BEV_SENSOR]) > terms->most_apart_k
      || fabs(mean[BEV_UNDER_WAY]) > terms->most_apart_k;
}

/* As bev_preheat.numerics: mean, variance, log of the probability. */
static void moments_in_tail(double distance, double width, double moments[3]) {
  const double log_density = -0.5 * distance * distance - BEV_LOG_ROOT_2_PI;
  double x = distance * width;
  if (x < 1e-4) {
    moments[0] = 0.5 * width;
    moments[1] = width * width / 12.0;
    moments[2] = log_density + log(width);
    return;
  }
  x = bev_minimum(x, 700.0);
  const double grown = expm1(x);
  moments[0] = 1.0 / distance - width / grown;
  moments[1] = bev_maximum(
      0.0, 1.0 / (distance * distance) - width * width * (grown + 1.0) / (grown * grown));
  moments[2] = log_density + log(-expm1(-x) / distance);
}

static void truncated_moments(double mean, double variance, double low, double high, double moments[3]) {
  const double deviation = sqrt(variance);
  const double a = (low - mean) / deviation;
  const double b = (high - mean) / deviation;
  if (b - a < 1e-9) {
    moments[0] = 0.5 * (low + high);
    moments[1] = 0.0;
    moments[2] = -0.5 * a * a - BEV_LOG_ROOT_2_PI - log(deviation);
    return;
  }
  if (a > BEV_TAIL) {
    moments_in_tail(a, b - a, moments);
    moments[0] = low + deviation * moments[0];
    moments[1] = variance * moments[1];
    return;
  }
  if (b < -BEV_TAIL) {
    moments_in_tail(-b, b - a, moments);
    moments[0] = high - deviation * moments[0];
    moments[1] = variance * moments[1];
    return;
  }
  double probability;
  if (a > 0.0) {
    probability = 0.5 * (erfc(a / BEV_ROOT_2) - erfc(b / BEV_ROOT_2));
  } else if (b < 0.0) {
    probability = 0.5 * (erfc(-b / BEV_ROOT_2) - erfc(-a / BEV_ROOT_2));
  } else {
    probability = 0.5 * (erf(b / BEV_ROOT_2) - erf(a / BEV_ROOT_2));
  }
  const double density_a = exp(-0.5 * a * a - BEV_LOG_ROOT_2_PI);
  const double density_b = exp(-0.5 * b * b - BEV_LOG_ROOT_2_PI);
  const double shift = (density_a - density_b) / probability;
  const double spread = 1.0 + (a * density_a - b * density_b) / probability - shift * shift;
  moments[0] = mean + deviation * shift;
  moments[1] = variance * bev_maximum(spread, 0.0);
  moments[2] = log(probability);
}

/* Weigh the hypotheses by the logarithms of their likelihoods, each clipped at `most_evidence`. */
static void weigh(const bev_belief *belief, const bev_belief_terms *terms, const double *logs, double likeliest) {
  const int32_t filters = belief->heaters * belief->noises;
  double total = 0.0;
  for (int32_t filter = 0; filter < filters; filter++) {
    const double weight = belief->weights[filter]
        * exp(bev_maximum(logs[filter] - likeliest, -terms->most_evidence));
    belief->weights[filter] = bev_maximum(weight, terms->least_weight);
    total += belief->weights[filter];
  }
  for (int32_t filter = 0; filter < filters; filter++) {
    belief->weights[filter] /= total;
  }
}

static bev_status see_interval(const bev_belief *belief, const bev_belief_terms *terms, int32_t element,
                               const double *noise_variance, double low, double high, int32_t tells_hypotheses,
                               int32_t *lost) {
  if (!isfinite(low) || !isfinite(high) || low > high) {
    return BEV_BAD_INPUT;
  }
  const int32_t filters = belief->heaters * belief->noises;
  double *const logs = belief->memory;
  double *const seen = &logs[filters];
  /* A sensor is read together with its local rise. */
  const int32_t also = element == BEV_SENSOR ? BEV_LOCAL : element;
  const double share = element == BEV_SENSOR ? 1.0 : 0.0;
  double likeliest = -DBL_MAX;
  for (int32_t filter = 0; filter < filters; filter++) {
    const double *const own = &belief->covariance[filter * SQUARE];
    const double variance = bev_maximum(
        own[element * BEV_ELEMENTS + element]
            + share * (own[element * BEV_ELEMENTS + also] + own[also * BEV_ELEMENTS + element]
                       + own[also * BEV_ELEMENTS + also])
            + noise_variance[filter % belief->noises],
        terms->least_variance);
    const double mean = belief->mean[filter * BEV_ELEMENTS + element]
        + share * belief->mean[filter * BEV_ELEMENTS + also];
    double moments[3];
    truncated_moments(mean, variance, low, high, moments);
    if (!isfinite(moments[0]) || !isfinite(moments[1]) || !isfinite(moments[2])) {
      return BEV_NOT_FINITE;
    }
    seen[3 * filter] = variance;
    seen[3 * filter + 1] = moments[0] - mean;
    seen[3 * filter + 2] = variance - moments[1];
    logs[filter] = moments[2];
    likeliest = bev_maximum(likeliest, moments[2]);
  }
  *lost = 0;
  for (int32_t filter = 0; filter < filters; filter++) {
    double *const mean = &belief->mean[filter * BEV_ELEMENTS];
    double *const covariance = &belief->covariance[filter * SQUARE];
    double gain[BEV_ELEMENTS];
    for (int32_t i = 0; i < BEV_ELEMENTS; i++) {
      gain[i] = (covariance[i * BEV_ELEMENTS + element] + share * covariance[i * BEV_ELEMENTS + also])
          / seen[3 * filter];
    }
    update(mean, covariance, gain, seen[3 * filter + 1], seen[3 * filter + 2]);
    *lost += hold(terms, mean);
  }
  if (tells_hypotheses) {
    weigh(belief, terms, logs, likeliest);
  }
  return BEV_OK;
}

static bev_status see_propulsion_power(const bev_belief *belief, const bev_belief_terms *terms,
                                       const bev_passed *passed, int32_t *lost) {
  if (!isfinite(passed->seen_w) || !isfinite(passed->route_w) || !isfinite(passed->variance_w2)
      || !(passed->variance_w2 > 0.0)) {
    return BEV_BAD_INPUT;
  }
  *lost = 0;
  for (int32_t filter = 0; filter < belief->heaters * belief->noises; filter++) {
    double *const mean = &belief->mean[filter * BEV_ELEMENTS];
    double *const covariance = &belief->covariance[filter * SQUARE];
    const double expected_w = exp(mean[BEV_PROPULSION]) * passed->route_w;
    const double total =
        expected_w * expected_w * covariance[BEV_PROPULSION * BEV_ELEMENTS + BEV_PROPULSION]
        + passed->variance_w2;
    const double error_w =
        bev_minimum(bev_maximum(passed->seen_w - expected_w, -passed->most_w), passed->most_w);
    double gain[BEV_ELEMENTS];
    for (int32_t i = 0; i < BEV_ELEMENTS; i++) {
      gain[i] = covariance[i * BEV_ELEMENTS + BEV_PROPULSION] * expected_w;
    }
    update(mean, covariance, gain, error_w / total, 1.0 / total);
    *lost += hold(terms, mean);
  }
  return BEV_OK;
}

bev_status bev_follow(const bev_vehicle *vehicle, const bev_belief *belief, const bev_belief_terms *terms,
                      const bev_passed *passed, int32_t *lost) {
  if (vehicle == NULL || !is_belief(belief) || terms == NULL || passed == NULL
      || passed->transitions == NULL || passed->wander == NULL || lost == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  if (!bev_is_vehicle(vehicle)) {
    return BEV_BAD_VEHICLE;
  }
  *lost = 0;
  bev_status status = mix_belief(belief, passed->transitions);
  if (status == BEV_OK) {
    status = move_belief(vehicle, belief, terms, passed);
  }
  if (status == BEV_OK && passed->drive.is_seen != 0) {
    status = see_propulsion_power(belief, terms, passed, lost);
  }
  return status;
}

bev_status bev_take_reading(const bev_belief *belief, const bev_belief_terms *terms, const bev_reading *reading,
                            double *mean, double *covariance, int32_t *lost) {
  if (!is_belief(belief) || terms == NULL || reading == NULL || reading->noise_variances_k2 == NULL
      || reading->noise_variances == NULL || mean == NULL || covariance == NULL || lost == NULL) {
    return BEV_BAD_ARGUMENT;
  }
  *lost = 0;
  bev_status status =
      see_interval(belief, terms, BEV_SENSOR, reading->noise_variances_k2,
                       reading->lowest_c, reading->highest_c, 1, lost);
  if (status == BEV_OK && *lost == 0) {
    status = see_interval(belief, terms, BEV_SOC, reading->noise_variances,
                              reading->lowest_soc, reading->highest_soc, 0, lost);
  }
  if (status == BEV_OK && *lost == 0) {
    blend(belief, 0, 1, belief->heaters * belief->noises, belief->weights, mean, covariance);
  }
  return status;
}
