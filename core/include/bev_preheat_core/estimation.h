/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The computations of bev_preheat's estimation in each update, in C99: filters over the state of the car, and the
 * sensitivity of the arrival to it. Memory, loops, numbers and statuses are as in core.h.
 */
#ifndef BEV_PREHEAT_CORE_ESTIMATION_H_
#define BEV_PREHEAT_CORE_ESTIMATION_H_

#include "bev_preheat_core/core.h"

#ifdef __cplusplus
extern "C" {
#endif

/*
 * Elements of the state, documented in bev_preheat.estimation.estimate. Elements that are logarithms are of factors
 * (heat capacity to other sources' heat) and of lags over nominal lags.
 */
enum {
  BEV_TEMPERATURE = 0,
  BEV_SOC,
  BEV_HEAT_CAPACITY,
  BEV_LEAKAGE,
  BEV_RESISTANCE,
  BEV_HEATER,
  BEV_PROPULSION,
  BEV_SOURCE_HEAT,
  BEV_HEAT_LAG,
  BEV_SENSOR_LAG,
  BEV_JOULE_RISE,
  BEV_SENSOR_PLACE,
  BEV_UNDER_WAY,
  BEV_SENSOR,
  BEV_LOCAL,
  BEV_ELEMENTS
};

/* Number of factors, and of elements with bounds: the factors, the lags, the local rise and the sensor's place. */
#define BEV_FACTORS 6
#define BEV_BOUNDED 10
/* Maximum number of heater hypotheses and of noise hypotheses; the memory of a belief [doubles]. */
#define BEV_MOST_HEATERS 16
#define BEV_MOST_NOISES 8
#define BEV_MOST_FILTERS (BEV_MOST_HEATERS * BEV_MOST_NOISES)
#define BEV_BELIEF_MEMORY(filters) ((filters) * (1 + BEV_ELEMENTS + BEV_ELEMENTS * BEV_ELEMENTS))

/*
 * One extended Kalman filter for each hypothesis, `heaters` times `noises` in total: weights, means (BEV_ELEMENTS
 * each) and covariances (BEV_ELEMENTS * BEV_ELEMENTS each). `memory` has BEV_BELIEF_MEMORY doubles; it holds
 * nothing between calls. A call that does not return BEV_OK leaves the filters unchanged.
 */
typedef struct {
  int32_t heaters;
  int32_t noises;
  double *weights;
  double *mean;
  double *covariance;
  double *memory;
} bev_belief;

/* Parameters that all filters share; see bev_preheat.estimation.belief. */
typedef struct {
  /* Perturbation of each element for numerical derivatives. */
  double perturbation[BEV_ELEMENTS];
  /* Bounds of the elements from BEV_HEAT_CAPACITY on. */
  double lowest[BEV_BOUNDED];
  double highest[BEV_BOUNDED];
  double nominal_heat_lag_s;
  double nominal_sensor_lag_s;
  double local_lag_s;
  /* Share of a described shell, or 0; without it: most lag of heat outside the battery [s], excess of a shell [K/K]. */
  double shell_share;
  double outside_lag_s;
  double unseen_shell_rise;
  double least_variance;
  double least_weight;
  /* Maximum loss of likelihood of a hypothesis by one reading, relative to the likeliest hypothesis [nats]. */
  double most_evidence;
  /* Maximum difference between battery and sensor, and maximum heat under way [K]. */
  double most_apart_k;
  /* Error of a route's power: its share, the least power to which the share applies [W], and its duration [s]. */
  double power_noise;
  double least_power_w;
  double power_noise_lasts_s;
  /* Spread of the local rise by Joule heat from one peak of the power to the next. */
  double joule_rise_noise_k_per_kw;
} bev_belief_terms;

/* The car's drive in one step, with the nominal leakage; see bev_preheat.vehicle.variants. */
typedef struct {
  double speed_mps;
  double ambient_temperature_c;
  double propulsion_power_w;
  double power_variance_w2;
  double propulsion_power_magnitude_w;
  double cabin_heating_power_w;
  double auxiliary_power_w;
  /* The last two are defined if `is_seen` is not 0. */
  double terminal_power_w;
  double hidden_variance_w2;
  double gamma_0_w_per_k;
  double gamma_v_w_per_k_per_mps;
  int32_t is_seen;
} bev_drive;

/*
 * The expected drive along a trip of `steps` steps, with the nominal leakage: the columns of its route, one after
 * the other as in bev_make_trip, the heater's power and other sources' heat in each step, and the battery's temperature and charge at the
 * start of each.
 */
typedef struct {
  int32_t steps;
  const double *route;
  const double *heater_power_w;
  const double *source_heat_w;
  const double *temperature_c;
  const double *soc;
  double gamma_0_w_per_k;
  double gamma_v_w_per_k_per_mps;
} bev_expected_drive;

/*
 * Elapsed time in a drive.
 *
 * `transitions[from * heaters + to]` is the probability that one heater turned into another, `wander` are the variances
 * that each element gains, `hidden_variance_s2` is the variance of the logarithm of the propulsion power times s^2. In
 * hypothesis h the heater takes heater_power_w[h], and other sources give the heat of a heater with source_heat_w[h].
 * The propulsion power seen and the route's [W] differ with a variance [W^2]; the difference is clipped at `most_w`.
 */
typedef struct {
  const double *transitions;
  const double *wander;
  double duration_s;
  double hidden_variance_s2;
  double seen_w;
  double route_w;
  double variance_w2;
  double most_w;
  double heater_power_w[BEV_MOST_HEATERS];
  double source_heat_w[BEV_MOST_HEATERS];
  bev_drive drive;
} bev_passed;

/*
 * A reading of the battery: the intervals of temperature [deg C] and charge, with the variance of each noise
 * hypothesis.
 */
typedef struct {
  const double *noise_variances_k2;
  const double *noise_variances;
  double lowest_c;
  double highest_c;
  double lowest_soc;
  double highest_soc;
} bev_reading;

/*
 * Mix the filters, because one heater may have turned into another, propagate them and, if `drive.is_seen`, compare
 * the propulsion power with the route's.
 *
 * The first status other than BEV_OK ends the sequence and is returned; the filters are those of the parts before it.
 * `lost` is the number of filters that have diverged.
 */
bev_status bev_follow(const bev_vehicle *vehicle, const bev_belief *belief, const bev_belief_terms *terms,
                      const bev_passed *passed, int32_t *lost);

/*
 * Update the filters with a reading: temperature, by the sensor with its local rise, and charge; then compute mean
 * (BEV_ELEMENTS) and covariance (BEV_ELEMENTS * BEV_ELEMENTS) over all hypotheses. As in bev_follow; if filters are
 * lost, the sequence ends, too.
 */
bev_status bev_take_reading(const bev_belief *belief, const bev_belief_terms *terms, const bev_reading *reading,
                            double *mean, double *covariance, int32_t *lost);

/*
 * Variance of the temperature on arrival [K^2]: by the uncertainty of the elements at the start, with this
 * covariance (BEV_ELEMENTS * BEV_ELEMENTS), and by the traffic in each step.
 */
bev_status bev_arrival_variance(const bev_vehicle *vehicle, const bev_expected_drive *expected,
                                const bev_belief_terms *terms, const double *covariance, double *variance_k2);

#ifdef __cplusplus
}
#endif

#endif /* BEV_PREHEAT_CORE_ESTIMATION_H_ */
