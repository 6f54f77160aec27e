/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What the estimation of bev_preheat computes in each update, in C99: filters over the state of the car, and how
 * the arrival depends on it. Memory, loops, numbers and statuses are as core.h has them.
 */
#ifndef BEV_PREHEAT_CORE_ESTIMATION_H_
#define BEV_PREHEAT_CORE_ESTIMATION_H_

#include "bev_preheat_core/core.h"

#ifdef __cplusplus
extern "C" {
#endif

/*
 * The estimation: bev_preheat.estimation.state says what the elements of its state are. Those that are
 * logarithms are of factors (heat capacity to propulsion) and of lags over nominal ones.
 */
enum {
  BEV_TEMPERATURE = 0,
  BEV_SOC,
  BEV_HEAT_CAPACITY,
  BEV_LEAKAGE,
  BEV_RESISTANCE,
  BEV_HEATER,
  BEV_PROPULSION,
  BEV_HEAT_LAG,
  BEV_SENSOR_LAG,
  BEV_JOULE_RISE,
  BEV_HEATER_RISE,
  BEV_UNDER_WAY,
  BEV_SENSOR,
  BEV_LOCAL,
  BEV_ELEMENTS
};

/* Factors, and the elements that are kept within bounds: the factors, the lags and the local rises. */
#define BEV_FACTORS 5
#define BEV_BOUNDED 9
/* Most heaters, and most kinds of noise, of which there are hypotheses; the memory of a belief [doubles]. */
#define BEV_MOST_HEATERS 16
#define BEV_MOST_NOISES 8
#define BEV_MOST_FILTERS (BEV_MOST_HEATERS * BEV_MOST_NOISES)
#define BEV_BELIEF_MEMORY(filters) ((filters) * (1 + BEV_ELEMENTS + BEV_ELEMENTS * BEV_ELEMENTS))

/*
 * One extended Kalman filter for each hypothesis, `heaters` times `noises` of them: weights, means
 * (BEV_ELEMENTS each) and covariances (BEV_ELEMENTS * BEV_ELEMENTS each). `memory` is the caller's, of
 * BEV_BELIEF_MEMORY doubles; nothing is kept in it. A call that does not return BEV_OK leaves them as
 * they were.
 */
typedef struct {
  int32_t heaters;
  int32_t noises;
  double *weights;
  double *mean;
  double *covariance;
  double *memory;
} bev_belief;

/* What is the same for all filters; see bev_preheat.estimation.belief. */
typedef struct {
  /* By how much each element is moved to see what depends on it. */
  double perturbation[BEV_ELEMENTS];
  /* Bounds of the elements from BEV_HEAT_CAPACITY on. */
  double lowest[BEV_BOUNDED];
  double highest[BEV_BOUNDED];
  double nominal_heat_lag_s;
  double nominal_sensor_lag_s;
  double local_lag_s;
  double least_variance;
  double least_weight;
  /* How much less likely than the likeliest a reading makes a hypothesis, at most [nats]. */
  double most_evidence;
  /* How far battery and sensor may be apart, and how much heat may be under way [K]. */
  double most_apart_k;
  double most_under_way_k;
  /* A route's power is wrong by this share of it, and of this power [W] at least, for so long [s]. */
  double power_noise;
  double least_power_w;
  double power_noise_lasts_s;
  /* How much the local rise by Joule heat differs from one peak of the power to the next. */
  double joule_rise_noise_k_per_kw;
} bev_belief_terms;

/* What the car does in one step; see bev_preheat.vehicle.uncertain_car. With the nominal leakage. */
typedef struct {
  double speed_mps;
  double ambient_temperature_c;
  double propulsion_power_w;
  double power_variance_w2;
  double propulsion_power_magnitude_w;
  double cabin_heating_power_w;
  double auxiliary_power_w;
  /* The last two mean something where `is_seen` is not 0. */
  double terminal_power_w;
  double hidden_variance_w2;
  double gamma_0_w_per_k;
  double gamma_v_w_per_k_per_mps;
  int32_t is_seen;
} bev_drive;

/*
 * The same along a trip of `steps` steps: the columns of its route, one after the other as bev_make_trip takes
 * them, the heater's power in each step, and the battery's course at the start of each. With the nominal leakage.
 */
typedef struct {
  int32_t steps;
  const double *route;
  const double *heater_power_w;
  const double *temperature_c;
  const double *soc;
  double gamma_0_w_per_k;
  double gamma_v_w_per_k_per_mps;
} bev_expected_drive;

/* Time that has passed in a drive: what bev_mix_belief, bev_move_belief and bev_see_propulsion_power take. */
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
  bev_drive drive;
} bev_passed;

/* A reading of the battery: the intervals in which temperature [deg C] and charge lie, with the noise of each kind. */
typedef struct {
  const double *noise_variances_k2;
  const double *noise_variances;
  double lowest_c;
  double highest_c;
  double lowest_soc;
  double highest_soc;
  /* Whether the weights follow the temperature. */
  int32_t tells_hypotheses;
} bev_reading;

/* Mix the filters: `transitions[from * heaters + to]` is how likely one heater turned into another. */
bev_status bev_mix_belief(const bev_belief *belief, const double *transitions);

/*
 * Let `duration_s` pass in a drive in which the heater of hypothesis h takes heater_power_w[h].
 *
 * `wander` are the variances that each element gains, `hidden_variance_s2` the variance of the logarithm
 * of the propulsion power times s^2: what it makes of temperature and charge is added.
 */
bev_status bev_move_belief(const bev_vehicle *vehicle, const bev_belief *belief,
                           const bev_belief_terms *terms, const bev_drive *drive,
                           double duration_s, const double *heater_power_w, const double *wander,
                           double hidden_variance_s2);

/*
 * Take into account that an element, with the noise of each kind [variance], lies within low ... high.
 *
 * BEV_SENSOR is the sensor with its local rise. With `tells_hypotheses` the weights follow. `lost` is how many
 * filters are beyond what means anything.
 */
bev_status bev_see_interval(const bev_belief *belief, const bev_belief_terms *terms,
                            int32_t element, const double *noise_variance, double low, double high,
                            int32_t tells_hypotheses, int32_t *lost);

/*
 * Compare the propulsion power seen with the route's [W]; the difference has a variance [W^2], and is
 * clipped at `most_w`. `lost` as above.
 */
bev_status bev_see_propulsion_power(const bev_belief *belief, const bev_belief_terms *terms,
                                    double seen_w, double route_w, double variance_w2,
                                    double most_w, int32_t *lost);

/* Mean (BEV_ELEMENTS) and covariance (BEV_ELEMENTS * BEV_ELEMENTS) over all hypotheses. */
bev_status bev_expect(const bev_belief *belief, double *mean, double *covariance);

/*
 * Mix the filters, move them, and, where `drive.is_seen`, compare the propulsion power: the three calls in one.
 *
 * `done` is how many of them were; one that does not return BEV_OK ends the call, and what it returns is
 * returned. `lost` as above.
 */
bev_status bev_follow(const bev_vehicle *vehicle, const bev_belief *belief,
                      const bev_belief_terms *terms, const bev_passed *passed, int32_t *done,
                      int32_t *lost);

/*
 * Take a reading's temperature and charge into account, and say what is expected then: bev_see_interval
 * twice, and bev_expect. `done` and `lost` as in bev_follow; where filters are lost nothing more is done.
 */
bev_status bev_take_reading(const bev_belief *belief, const bev_belief_terms *terms,
                            const bev_reading *reading, double *mean, double *covariance,
                            int32_t *done, int32_t *lost);

/*
 * Variance of the temperature on arrival [K^2]: of what is believed of the elements at the start, with this
 * covariance (BEV_ELEMENTS * BEV_ELEMENTS), and of the traffic in each step.
 */
bev_status bev_arrival_variance(const bev_vehicle *vehicle, const bev_expected_drive *expected,
                                const bev_belief_terms *terms, const double *covariance,
                                double *variance_k2);

#ifdef __cplusplus
}
#endif

#endif /* BEV_PREHEAT_CORE_ESTIMATION_H_ */
