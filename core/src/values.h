/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The parts of bev_preheat.planning.methods: ends of a step (value_steps.c), values of a layer
 * (value_layers.c), the path of the pass before and its prices (value_path.c), the run (value_run.c), and the passes
 * (value_function.c).
 */
#ifndef BEV_PREHEAT_CORE_VALUES_H_
#define BEV_PREHEAT_CORE_VALUES_H_

#include "bev_preheat_core_generated/constants.h"
#include "checks.h"
#include "limited_run.h"

/* The ends of a step: cooled, heater off, with the surplus, at full power, or with the best sources. */
#define MOST_ENDS (2 + BEV_MOST_SOURCES)

/* Limits that act in a step. */
#define LIMITED_COMMAND 1u
#define BRAKED 2u
#define LACKING 4u
#define HOT 8u

/* Values at one instant: `points` temperatures from `least_c` on; heater off or on in the step before. */
typedef struct {
  double least_c;
  double step_k;
  int32_t points;
  double *off_j;
  double *on_j;
} layer;

typedef struct {
  double states[4];
  double powers_w[4];
  /* Battery energy, with the penalties of the step [J]. */
  double cost_j;
  /* The temperature that the battery comes to from the heat already in heater and coolant. */
  double settled_c;
  double wanted_w;
  int32_t kind;
  int32_t takes_surplus;
  /* The limits that act: command, brake, missing power, highest temperature. */
  uint32_t regime;
} step_end;

/* The ends of a step from one temperature. */
typedef struct {
  step_end ends[MOST_ENDS];
  int32_t count;
} step_ends;

/* A mixture of an end and the next one: `share` of the next one. */
typedef struct {
  double value_j;
  double share;
  int32_t end;
  int32_t direction;
} mixture;

/* Directions of heat: -1 cools, 0 off, 1 heats; ANY_DIRECTION: on, either way. */
#define ANY_DIRECTION 2

/* The best mixtures that cool, that do neither, and that heat: without the price of switching on. */
typedef struct {
  mixture by_direction[3];
} choice;

typedef struct {
  const bev_vehicle *vehicle;
  const bev_trip *trip;
  const bev_value_goal *goal;
  /* Without and with surplus: as the vehicle is driven, and as the recursion sees it, with heat at once. */
  bev_limited_run driven[2];
  bev_limited_run at_once[2];
  /* Where a limit may matter: on any run, and within the layers. */
  uint8_t *overcharge;
  uint8_t *overdraw;
  uint8_t *layers_overcharge;
  uint8_t *layers_overdraw;
  double joules_per_k;
  double lag_s;
  double coolant_lag_s;
  /*
   * Time to go [s]; of a step's heat in the battery the share there at the end, how much less of heat that enters a
   * shell, and the share of the heater's.
   */
  double *left_s;
  double *kept_share;
  double *drained_share;
  double *arriving_share;
  /* Of a step's heat from the heater, the share still under way at its end, and how that decays over a step. */
  double *late_share;
  /* The path before: charge, settled temperature, heat under way [K]; the worth of charge beyond its energy [J]. */
  double *soc;
  double *path_c;
  double *under_way_k;
  double *price_j;
  /* Of this, the most that charge is worth for the power of a step from the instant on, in a backward pass. */
  double for_power_j;
  /* The cost of a kelvin that is still under way at an instant [J]. */
  double *late_price_j;
  /* Of a joule that the heater is still to draw at an instant, the battery's part; its share of a step's. */
  double *due_share;
  double *due_price;
  double *commands_w;
  double *tried_w;
  /* Where the layers lie: the first temperature of each, and what all have in common. */
  double *least_c;
  double step_k;
  int32_t points;
  /* Of what becomes known on the way, as far as the pass expects that. */
  double deviation_k;
  /* Every n-th layer is kept from the backward pass to the forward pass; the values of the layers. */
  int32_t kept_every;
  double *values_j;
  /* The best run so far: states, powers. */
  double *kept;
  /* Cost of a joule that the battery cannot deliver. */
  double lack_price;
  double switch_on_j;
  int32_t is_certain;
  int32_t has_prices;
  /* The largest power deficit of the unheated run [W]. */
  double unheated_lack_w;
  /* The target of the latest pass, or the temperature that the reserve allows [deg C]. */
  double aim_c;
} recursion;

static inline int32_t direction_of(double power_w) {
  return fabs(power_w) <= BEV_LEAST_HEATING_W ? 0 : power_w < 0.0 ? -1 : 1;
}

static inline double voltage_v(const recursion *of, double soc, double temperature_c) {
  return bev_at(&of->vehicle->open_circuit_voltage, 0, soc, temperature_c);
}

/* The factor of battery energy in step k. */
static inline double price_in(const recursion *of, int32_t k) {
  return of->goal->price == NULL ? 1.0 : of->goal->price[k];
}

static inline double joules_of_charge(const recursion *of, double voltage) {
  return of->vehicle->capacity_ah * 3600.0 * voltage;
}

/*
 * Where the layer at instant k lies. Counted from the arrival, every `kept_every`-th has a place of its own; those in
 * between have the places that all blocks share.
 */
static inline double *values_at(const recursion *of, int32_t k) {
  const int32_t every = of->kept_every;
  const int32_t left = of->trip->steps - k;
  const int32_t place =
      left % every == 0 ? left / every : of->trip->steps / every + left % every;
  return &of->values_j[(size_t)place * 2u * BEV_VALUE_POINTS];
}

static inline layer layer_at(const recursion *of, int32_t k) {
  double *const values_j = values_at(of, k);
  const layer at = {of->least_c[k], of->step_k, of->points, values_j, &values_j[BEV_VALUE_POINTS]};
  return at;
}

/* The value of a temperature; outside its layer the path must come back. */
static inline double worth_j(const recursion *of, const layer *at, double temperature_c, int32_t is_on) {
  const double *values_j = is_on != 0 ? at->on_j : at->off_j;
  const double place = (temperature_c - at->least_c) / at->step_k;
  const int32_t last = at->points - 1;
  if (!(place > 0.0)) {
    return values_j[0] - place * at->step_k * 2.0 * BEV_SHORT_PRICE * of->joules_per_k;
  }
  if (place >= (double)last) {
    return values_j[last]
        + (place - (double)last) * at->step_k * BEV_BEYOND_PRICE * of->joules_per_k;
  }
  const int32_t n = (int32_t)place;
  return values_j[n] + (place - (double)n) * (values_j[n + 1] - values_j[n]);
}

/* Heat in heater and coolant that reaches the battery by the end of the trip, from instant k on [K]. */
static inline double under_way_k(const recursion *of, int32_t k, const double states[4]) {
  const bev_limited_run *run = &of->driven[0];
  if (run->is_direct != 0) {
    return 0.0;
  }
  const double heater = of->lag_s > 0.0 ? -expm1(-of->left_s[k] / of->lag_s) : 1.0;
  const double coolant =
      of->coolant_lag_s > 0.0 ? -expm1(-of->left_s[k] / of->coolant_lag_s) : 0.0;
  return heater * run->k_per_watt * states[2] + coolant * run->share_of_excess * states[3];
}

/* Power of a step beyond the discharge limit at either end [W]. */
double bev_lacking_w(const recursion *of, int32_t k, const double start[4], const step_end *end,
                     double terminal_w);

/* Drive step k to the end whose `wanted_w` and `takes_surplus` are given. */
bev_status bev_drive_step(const recursion *of, int32_t k, const double start[4], int32_t is_ahead, step_end *end);

/* Where the recursion sees the end of a step from a temperature on: heat counts as far as it arrives in time. */
double bev_seen_ahead_c(const recursion *of, int32_t k, double settled_c, const double start[4],
                        const step_end *end);

/*
 * The ends of step k from charge and temperature, heat under way left out, as the recursion sees them. A step that
 * empties the battery has none.
 */
bev_status bev_ends_of_step(const recursion *of, int32_t k, const double start[4], double settled_c,
                            step_end ends[MOST_ENDS], int32_t *count);

/*
 * The best mixtures of an end and the next one, for each direction. Between the ends, the best lies at a temperature of
 * the next layer, as values are straight in between.
 */
choice bev_best_of(const recursion *of, const step_end ends[MOST_ENDS], int32_t count, const layer *next);

/* The best of all after a direction of heat, its value with the price of switching on. */
mixture bev_better_of(const recursion *of, const choice *best, int32_t before);

/* The backward pass: the values of all layers, from that of the arrival at `aim_c`. */
bev_status bev_find_values(recursion *of, double aim_c);

/*
 * If layer k has a place of its own, find again the layers between it and the next layer that has. Prices and limits of
 * each step are those of the backward pass, so the values are too. The layers of the first block, with which the
 * backward pass ended, are still there.
 */
bev_status bev_find_block_again(const recursion *of, int32_t k);

/*
 * What charge at instant k is worth beyond its energy [J]: how the cost on the path changes with it, heated as it is
 * best there. That the battery delivers less with less charge is left out: heat repairs it, at the price of heat.
 */
bev_status bev_price_of_charge(recursion *of, int32_t k, const layer *next);

/* The cost of a kelvin that is still under way at instant k [J]: the battery is colder, and limits tighter. */
bev_status bev_price_of_lateness(recursion *of, int32_t k, const layer *next);

/* Where a limit may matter within the layers of two neighbouring instants. */
void bev_watch_step(const recursion *of, int32_t k, const layer layers[2]);

/* Keep the run as the path for the next pass; how far it lies from the path before [K]. */
double bev_keep_path(const recursion *of, const double *states);

/* No prices of charge and of heat under way before the first pass. */
void bev_forget_prices(const recursion *of);

/* Write the end of step k into the run. */
void bev_write_step(const recursion *of, int32_t k, const step_end *end, double *states, double *powers_w);

/* Drive the commands from step `first` on; null: only surplus heats. */
bev_status bev_drive_commands(const recursion *of, const double *commands_w, int32_t first, double *states,
                              double *powers_w);

/*
 * How much warmer than needed the battery arrives [K]: than the target, or than the reserve of charge allows. With
 * `sign` -1: how much colder than the highest temperature.
 */
double bev_beyond_k(const recursion *of, const double *states, int32_t is_short_of_charge, double sign);

/* Cost of a temperature beyond the highest, for a vehicle that cools [J]. */
static inline double hot_j(const recursion *of, double temperature_c) {
  return bev_cools(of->trip) ? BEV_SHORT_PRICE * of->joules_per_k
          * bev_maximum(temperature_c - of->vehicle->highest_c, 0.0)
                             : 0.0;
}

/* The largest power deficit of a run [W]. */
double bev_most_lack_w(const recursion *of, const double *states, const double *powers_w);

/* The cost of a run [J]: battery, heater, power deficit, switching on, missed target and reserve. */
double bev_cost_of_run(const recursion *of, const double *states, const double *powers_w, double aim_c);

/* Keep a run as the best one so far. */
void bev_keep_run(const recursion *of, const double *states, const double *powers_w);

/* Take the best run so far. */
void bev_take_kept_run(const recursion *of, double *states, double *powers_w);

/* Let a run arrive exactly, unless that costs more. */
bev_status bev_finish(const recursion *of, double aim_c, double *states, double *powers_w, int32_t *ends_in);

#endif /* BEV_PREHEAT_CORE_VALUES_H_ */
