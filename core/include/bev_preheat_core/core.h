/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The planner's forward runs in C99: the battery of one vehicle along one trip; and its estimation.
 *
 * All memory is the caller's; nothing is allocated, kept or changed beyond the outputs that are named.
 * Every loop is bounded, by BEV_MOST_STEPS, BEV_MOST_AXIS or a number in the code. A number that is not
 * finite, or impossible, is answered by a status below BEV_OK; outputs then mean nothing. Units are SI,
 * temperatures are in degrees Celsius, states of charge 0 ... 1. The reference is the Python package
 * bev_preheat, from whose equations the model's steps are generated: equal inputs give equal bits,
 * where compiled with -ffp-contract=off and with the same exp and log.
 */
#ifndef BEV_PREHEAT_CORE_CORE_H_
#define BEV_PREHEAT_CORE_CORE_H_

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Changes when a struct or a function changes its meaning and keeps its form. */
#define BEV_INTERFACE 6

/* Most steps of a trip; where memory is fixed, compile with less: -DBEV_MOST_STEPS=360. */
#ifndef BEV_MOST_STEPS
#define BEV_MOST_STEPS 1000000
#endif
/* States that curves and limits are worked out for side by side; where stack is scarce, compile with less. */
#ifndef BEV_BLOCK
#define BEV_BLOCK 32
#endif
/* Most points of a table's axis, factors on a curve, bands of heating. */
#define BEV_MOST_AXIS 1024
#define BEV_MOST_FACTORS 4
#define BEV_CURVE_PARAMETERS 5
#define BEV_BANDS 2
/*
 * Points of a value curve that there is room for (half of them after it was thinned), most points of its grid, and
 * the room it takes [doubles].
 */
#define BEV_CURVE_POINTS 2048
#define BEV_MOST_GRID 512
#define BEV_CURVE_MEMORY (11 * BEV_CURVE_POINTS + 5 * BEV_MOST_GRID)
/* Most bands of one stride in which heating may pay, of which BEV_BANDS are told. */
#define BEV_MOST_LOWER_BANDS 32
/* Memory of bev_plan_switch for a trip of so many steps [doubles]. */
#define BEV_SWITCH_MEMORY(steps) (8 * ((steps) + 1))
/* Memory of bev_find_two_switches [doubles]. */
#define BEV_TWO_SWITCHES_MEMORY(steps) ((steps) + 1)
/* Memory of bev_plan_trips for a longest trip of so many steps: doubles, and bytes. */
#define BEV_TRIPS_MEMORY(steps) (12 * ((steps) + 1))
#define BEV_TRIPS_FLAGS(steps) (2 * (steps))

typedef enum {
  BEV_OK = 0,
  /* Done; the battery lacks power in at least one step, which is driven with the most it can give. */
  BEV_SATURATED = 1,
  /* The charge runs out in a step; what comes after it is not written. */
  BEV_EMPTY = 2,
  /* The backward run does not meet the unheated one. */
  BEV_NO_CROSSING = 3,
  /* A limit of the battery is active; what is written means nothing. */
  BEV_LIMITED = 4,
  /* Heating in other steps may cost less; what is written means nothing. */
  BEV_CHEAPER_ELSEWHERE = 5,
  /* A pointer is null, or a count out of its range. */
  BEV_BAD_ARGUMENT = -1,
  /* A number of the vehicle is not finite or impossible. */
  BEV_BAD_VEHICLE = -2,
  /* An input of a step, or a state at the start, is not finite. */
  BEV_BAD_INPUT = -3,
  /* The model yields no finite number. */
  BEV_NOT_FINITE = -4,
  /* A search within a step did not end in the number of rounds it is given. */
  BEV_NOT_SETTLED = -5
} bev_status;

/* How the model is integrated. */
typedef enum {
  BEV_EULER = 0,
  BEV_MIDPOINT = 1,
  BEV_RUNGE_KUTTA_4 = 2
} bev_integrator;

/* Formulas of bev_preheat.vehicle.curves; what their parameters are is said there. */
typedef enum {
  BEV_POLYNOMIAL = 0,
  BEV_POLYNOMIAL_AND_LOGARITHM = 1,
  BEV_INVERSE_TEMPERATURE = 2,
  BEV_TABLE = 3
} bev_curve_kind;

/*
 * A quantity over state of charge and battery temperature: a formula or a table, times factors.
 *
 * Of a table `values[i * temperature_count + j]` belongs to soc[i] and temperature_c[j]; axes rise, an
 * axis with one point means that the value does not depend on it. Linear between the points, level
 * beyond them. The factors are applied one after the other.
 */
typedef struct {
  int32_t kind;
  int32_t factor_count;
  int32_t soc_count;
  int32_t temperature_count;
  double parameter[BEV_CURVE_PARAMETERS];
  double factor[BEV_MOST_FACTORS];
  const double *soc;
  const double *temperature_c;
  const double *values;
} bev_curve;

/* One vehicle, as bev_preheat.vehicle.description has it; a heat path of zeros is a direct one. */
typedef struct {
  double capacity_ah;
  double heat_capacity_j_per_k;
  /* Lowest and highest temperature of the battery's range, and the highest that is planned with [deg C]. */
  double lowest_c;
  double highest_c;
  double hottest_c;
  double heater_efficiency;
  /* Part of the magnitude of the propulsion power that heats the battery. */
  double heat_share;
  double heater_lag_s;
  double coolant_heat_capacity_j_per_k;
  double coolant_conductance_w_per_k;
  bev_curve open_circuit_voltage;
  bev_curve resistance;
  /* Least and most power of the cells [W]: charge negative, discharge positive. */
  bev_curve charge_power_limit;
  bev_curve discharge_power_limit;
} bev_vehicle;

/* A trip of `steps` steps; arrays of that length, `time_s` one longer. */
typedef struct {
  int32_t steps;
  const double *time_s;
  const double *duration_s;
  /* Terminal power, and heat into the battery, without battery heating [W]. */
  const double *idle_power_w;
  const double *power_variance_w2;
  const double *idle_heat_w;
  const double *leakage_w_per_k;
  /* What the cabin leaves of the heater [W]. */
  const double *heater_limit_w;
  const double *propulsion_power_w;
  /* Of the idle heat, what comes from the drivetrain [W]. */
  const double *drivetrain_heat_w;
  const double *ambient_temperature_c;
  /*
   * How warm surplus regeneration may make the battery by the end of each step [deg C], as bev_find_surplus_ceiling
   * has it; null: up to 5 K below its highest temperature.
   */
  const double *surplus_ceiling_c;
} bev_trip;

/*
 * When a run within limits heats, arrays over the steps: with `power_w` [W] in each step where `bands`
 * is 0, else with so much below temperatures. In each of `bands` bands (arrays of steps * bands), from
 * `floor_c` to `low_c` at `power_w`, not at all from `high_c`, in between in proportion.
 */
typedef struct {
  int32_t bands;
  /* Regeneration that the battery does not take goes to the heater before it goes to the brake. */
  int32_t takes_surplus;
  const double *power_w;
  const double *floor_c;
  const double *low_c;
  const double *high_c;
  /* Steps in which the charge limit, and in which the discharge limit, may matter: not 0. */
  const uint8_t *may_overcharge;
  const uint8_t *may_overdraw;
} bev_heating;

/*
 * A run whose energies are asked for: states at each instant, and means over each step [W]. What the heater
 * takes, the heat that arrives from it (null: at once, all of it), and what the friction brake takes (null:
 * none). `is_deliverable` (not 0): it is known that the circuit gives every power that is asked for.
 */
typedef struct {
  int32_t is_deliverable;
  const double *soc;
  const double *temperature_c;
  const double *heater_w;
  const double *arriving_heat_w;
  const double *brake_w;
} bev_run_of_powers;

/*
 * Energies of a run [Wh]. `leakage` is negative where heat is lost; `battery_total` is what the cells give,
 * losses included. What a heater that lags takes after arrival is in none of them.
 */
typedef struct {
  double joule;
  double drivetrain_heat;
  double hvch_heat;
  double leakage;
  double hvch_electric;
  double battery_total;
} bev_energies;

/*
 * How careful a plan is, beyond its target: how many kelvin of heating the last interval begins early. With
 * `is_heating` (not 0) the heater is on, and pauses only for longer than `least_pause_s`. One that is off is not
 * switched on for less than `least_heating_s` before arrival.
 */
typedef struct {
  double lead_k;
  double least_pause_s;
  double least_heating_s;
  int32_t is_heating;
} bev_uncertainty_margin;

/* What is heated for; the numbers are those of PreheatPlan.stretch_reason. */
typedef enum {
  BEV_FOR_ARRIVAL = 0,
  /* So that the battery may take more of the regeneration ahead. */
  BEV_FOR_DESCENT = 2,
  /* So that the battery can deliver the power of the climb ahead. */
  BEV_FOR_CLIMB = 3
} bev_reason;

/*
 * What a trip is made with: the leakage at a speed, the share of the propulsion power's magnitude that warms the
 * battery, the leakage from which on steps must be shorter, the heater's power, the share of it that is there for
 * the battery, and how late its heat arrives.
 */
typedef struct {
  double gamma_0_w_per_k;
  double gamma_v_w_per_k_per_mps;
  double heat_share;
  double stiff_w_per_k;
  double heater_w;
  double heater_share;
  double heat_lag_s;
} bev_trip_terms;

/* What bev_plan_switch finds. */
typedef struct {
  /* From this instant on it is heated [s]; NaN where it is not. */
  double switching_instant_s;
  /* Where heating ends for good within a step [s]; NaN where it ends on arrival, or with a step. */
  double heating_end_s;
  double least_soc;
  /* What the heated steps take [Wh, electrical]. */
  double interval_wh;
  bev_energies energy_wh;
  int32_t is_heated;
  /* The first heated step, and the one after the last; `steps` both, where none is. */
  int32_t first_heated;
  int32_t end_heated;
  /* Whether all in between are heated, none with surplus, and then what for, a bev_reason. */
  int32_t is_one_interval;
  int32_t reason;
} bev_switch_plan;

/*
 * A digest of BEV_INTERFACE and of all structs, prototypes and memory sizes of these headers. A caller that loads the
 * library compares it with its own; sources that are compiled together do not need it.
 */
int32_t bev_interface(void);

/* BEV_OK, or BEV_BAD_VEHICLE or BEV_BAD_ARGUMENT. The runs do not look into the tables again. */
bev_status bev_check_vehicle(const bev_vehicle *vehicle);

/*
 * The columns of a trip from those of a route. `route` has eight arrays of `steps` values, one after the other:
 * duration, speed, mean and root mean square of the propulsion power, ambient temperature, cabin, auxiliaries,
 * mean magnitude of the propulsion power. Written are those of bev_trip in their order: time_s, of steps + 1
 * values, and nine of `steps`. A step that is too long for the integrators is a bad input.
 */
bev_status bev_make_trip(const bev_trip_terms *terms, int32_t steps, const double *route,
                         double *columns);

/* The value of a curve; NaN where there is none. `saturating` holds the charge within 0 ... 1. */
double bev_curve_value(const bev_curve *curve, int32_t saturating, double soc,
                       double temperature_c);

/*
 * One step of the model: `result` is the charge and the temperature at its end, the mean temperature
 * and the mean Joule heat [W]. With `saturating`, a power that the battery lacks is driven with the most
 * it can give; without, the result is not finite, and so is the status.
 */
bev_status bev_step(const bev_vehicle *vehicle, int32_t integrator, int32_t saturating, double soc,
                    double temperature_c, double duration_s, double power_w, double variance_w2,
                    double heat_w, double leakage_w_per_k, double result[4]);

/*
 * One Runge-Kutta step with the heat path: `result` is the four states at its end (charge, temperature,
 * the heater's power [W], the coolant's excess temperature [K]), mean temperature, mean Joule heat, and
 * the means of what the heater takes and of the heat that reaches the battery [W].
 */
bev_status bev_heated_step(const bev_vehicle *vehicle, int32_t saturating, const double states[4],
                           double duration_s, double power_w, double variance_w2, double heat_w,
                           double leakage_w_per_k, double command_w, double result[8]);

/*
 * The model over a trip, from step `first` on, limits left aside, heat at once.
 *
 * `heater_w` and `brake_w` are powers in each step of the whole trip [W]; null is none. soc[first] and
 * temperature_c[first] are the start; written are the values from first + 1 to `steps`.
 */
bev_status bev_run(const bev_vehicle *vehicle, int32_t integrator, const bev_trip *trip,
                   int32_t first, const double *heater_w, const double *brake_w, double *soc,
                   double *temperature_c);

/*
 * The same with the heat path: `command_w` is what the heater is told, and `states` are four arrays of
 * steps + 1 values, one after the other: charge, temperature, heater power [W], coolant excess [K].
 */
bev_status bev_run_heated(const bev_vehicle *vehicle, const bev_trip *trip, int32_t first,
                          const double *command_w, const double *brake_w, double *states);

/*
 * What heater and coolant do in the steps of a run: `heat_w` is two arrays of `steps` values, one after the
 * other, the means of what the heater takes and of the heat that reaches the battery [W]. `states` are as of
 * bev_run_heated, `brake_w` may be null.
 */
bev_status bev_heat_along(const bev_vehicle *vehicle, const bev_trip *trip, const double *states,
                          const double *command_w, const double *brake_w, double *heat_w);

/*
 * The instant [s] at which a run backward from the target, heated with all that the cabin leaves, meets
 * the unheated run. The backward run is given up `lost_k` above the target.
 */
bev_status bev_find_crossing(const bev_vehicle *vehicle, int32_t integrator, const bev_trip *trip,
                             double target_c, double terminal_soc, double lost_k,
                             const double *idle_temperature_c, double *instant_s);

/*
 * A run that keeps the battery's limits, from step `first` on, heat at once.
 *
 * soc[first] and temperature_c[first] are the start; written are the states after it, and what heater
 * and friction brake take in each step [W]. Where it returns BEV_EMPTY, `empty_step` is the step that
 * the charge does not carry, and its powers are the last that are written.
 */
bev_status bev_run_within_limits(const bev_vehicle *vehicle, const bev_trip *trip,
                                 const bev_heating *heating, int32_t first, double *soc,
                                 double *temperature_c, double *heater_w, double *brake_w,
                                 int32_t *empty_step);

/*
 * The same with the heat path: `states` as of bev_run_heated, `powers_w` four arrays of `steps` values, one
 * after the other: command, friction brake, what the heater takes, and heat into the battery, means [W].
 */
bev_status bev_run_heated_within_limits(const bev_vehicle *vehicle, const bev_trip *trip,
                                        const bev_heating *heating, int32_t first, double *states,
                                        double *powers_w, int32_t *empty_step);

/*
 * The least and the most terminal power [W] within the battery's limits, along `count` states and power
 * variances [W^2].
 */
bev_status bev_limits_along(const bev_vehicle *vehicle, int32_t count, const double *soc,
                            const double *temperature_c, const double *variance_w2,
                            double *least_w, double *most_w);

/*
 * The same for steps, whose power is to keep the limits at both ends: `soc` and `temperature_c` have a value
 * more than there are steps, the others one for each.
 */
bev_status bev_limits_of_steps(const bev_vehicle *vehicle, int32_t steps, const double *soc,
                               const double *temperature_c, const double *variance_w2,
                               double *least_w, double *most_w);

/*
 * A trip in strides, arrays of `strides` values: means of power, variance, heat, leakage, heater limit and
 * propulsion power over each, the charge at its start, the temperature about which its end is needed, the
 * shares of a joule that a fuller battery leaves to brake and heater [J/J], and whether charge or discharge
 * limit may matter in it (not 0). `coldest_c` and `warmest_c` have one value more: between these the
 * battery is at the start of each stride, and on arrival.
 */
typedef struct {
  int32_t strides;
  const double *duration_s;
  const double *idle_power_w;
  const double *power_variance_w2;
  const double *idle_heat_w;
  const double *leakage_w_per_k;
  const double *heater_limit_w;
  const double *propulsion_w;
  const double *soc;
  const double *end_c;
  const double *loss_to_brake;
  const double *loss_to_heater;
  const double *coldest_c;
  const double *warmest_c;
  const uint8_t *is_limited;
} bev_strides;

/*
 * Where the value curve is worked out: on a grid of rising temperatures, from the target on arrival, within
 * the coldest and the warmest temperature [deg C]. A watt that the battery lacks counts `penalty` times, and
 * a kelvin below the target `short_penalty` times what the heater takes for it.
 */
typedef struct {
  int32_t grid_points;
  /* Not 0: of the grid's points a part is enough in all strides, not only in those without limits. */
  int32_t is_first_look;
  const double *grid_c;
  double target_c;
  double coldest_c;
  double warmest_c;
  double penalty;
  double short_penalty;
} bev_curve_range;

/*
 * Below which temperatures heating pays in each stride: the value curve, run backward over all strides.
 *
 * `memory` has BEV_CURVE_MEMORY doubles. `bands_c` are three arrays of strides * BEV_BANDS, floor, low and
 * high of each band [deg C], the warmest band first; where there is none the floor is infinite.
 */
bev_status bev_find_bands(const bev_vehicle *vehicle, const bev_strides *strides,
                          const bev_curve_range *range, double *memory, double *bands_c);

/*
 * What a run is to meet: the target on arrival [deg C] and, with `serves_climbs`, the power of each climb.
 * Exchanges of heat lead to no state of charge below `lowest_soc`; thresholds do not look at it.
 */
typedef struct {
  int32_t serves_climbs;
  double target_c;
  double lowest_soc;
} bev_settling;

/* Where the charge of a run runs out: in this step (-1: in none), of which so large a share is driven. */
typedef struct {
  int32_t step;
  double driven_share;
} bev_stranding;

/*
 * How a run within limits ends whose charge runs out in the step of `stranding`: the share of it that is
 * driven is written, and what comes after it, where the vehicle stands. `states` and `powers_w`, as of
 * bev_settle, are known until that step, and the powers with which it was to be driven.
 */
bev_status bev_stand(const bev_vehicle *vehicle, const bev_trip *trip, double *states,
                     double *powers_w, bev_stranding *stranding);

/*
 * The run from a start that keeps the limits under heater commands [W]; surplus goes to the heater before it
 * goes to the brake, and where the charge runs out the vehicle stands. `states`, whose first ones are the start,
 * and `powers_w` are as of bev_settle. Of `watched`, 2 * steps bytes, the first `steps` say in which steps the
 * charge limit was looked at, the others the discharge limit.
 */
bev_status bev_drive_as_planned(const bev_vehicle *vehicle, const bev_trip *trip,
                                const double *command_w, double *states, double *powers_w,
                                uint8_t *watched, bev_stranding *stranding);

/* Room that bev_settle takes [doubles]. */
#define BEV_SETTLE_MEMORY(steps) (48 * (steps) + 20)

/*
 * The run within limits under thresholds, moved together by the little that is needed, that delivers each
 * climb it can, and arrives at the target.
 *
 * `heating` has bands. `states` are two arrays of steps + 1 values, charge and temperature, whose first ones
 * are the start, and `powers_w` two arrays of `steps`, heater and friction brake; of a vehicle with a heat
 * path, four and four as of bev_run_heated_within_limits. Where the charge runs out the vehicle stands for
 * the rest of the trip.
 */
bev_status bev_settle(const bev_vehicle *vehicle, const bev_trip *trip, const bev_heating *heating,
                      const bev_settling *goal, double *states, double *powers_w,
                      bev_stranding *stranding, double *memory);

/* The room that bev_merit_order takes: doubles, and bytes. */
#define BEV_MERIT_MEMORY(steps) \
  (BEV_SETTLE_MEMORY(steps) + BEV_CURVE_MEMORY + BEV_MOST_GRID + 44 * (steps) + 11)
#define BEV_MERIT_BYTES(steps) (5 * (steps))

/*
 * The run within limits that heats where a watt-hour of battery energy brings the most.
 *
 * `states` and `powers_w`, as of bev_settle, are the run without regard to limits; the best run that was
 * found is written over it. `lumped` is the vehicle whose heat arrives at once, in a battery that has the
 * coolant's heat capacity too; without a heat path the vehicle itself. `paid_w` is the most heater power that
 * each step is paid for [W]. Of `watched` (BEV_MERIT_BYTES) the first `steps`, and the `steps` that follow, say
 * in which steps the best run's charge limit, and its discharge limit, were looked at.
 */
bev_status bev_merit_order(const bev_vehicle *vehicle, const bev_vehicle *lumped,
                           const bev_trip *trip, const bev_settling *goal, const double *paid_w,
                           double *states, double *powers_w, bev_stranding *stranding,
                           uint8_t *watched, double *memory);

/* Room that bev_exchange_heat takes [doubles]. */
#define BEV_EXCHANGE_MEMORY(steps) (67 * (steps) + 2)

/*
 * The run within limits after heat was moved from steps in which it costs much to steps in which it costs little.
 *
 * `states` and `powers_w`, two arrays each as of bev_settle, are a run within limits that does not strand, of a
 * vehicle whose heat arrives at once. Where another one saves something, and falls no shorter of the goal's
 * target, of the power of the drive or of the goal's lowest charge, it is written over it, and `exchanges` says in how
 * many steps it was found; 0: nothing is written. `watched` is room for 2 * steps bytes.
 */
bev_status bev_exchange_heat(const bev_vehicle *vehicle, const bev_trip *trip,
                             const bev_settling *goal, double *states, double *powers_w,
                             uint8_t *watched, double *memory, int32_t *exchanges);

/* Memory of bev_plan_merit_order [doubles]; its `watched` has BEV_MERIT_BYTES. */
#define BEV_MERIT_PLAN_MEMORY(steps) (BEV_MERIT_MEMORY(steps) + (steps))

/* What a plan is beside its run. */
typedef struct {
  /* The first instant of heating [s]; NaN: there is none. */
  double start_s;
  /*
   * Where the heat arrives late, or heating begins early, the instant at which it ends for good [s]; NaN: on arrival.
   */
  double end_s;
  bev_stranding stranding;
} bev_merit_plan;

/*
 * The whole plan by merit order, from the unheated run on: the run that is heated in one interval, limits left
 * aside, where it keeps them all, or that of bev_heat_cheapest; else that of bev_merit_order, as it can be driven,
 * and, where heat arrives at once, bev_exchange_heat; where it arrives late, the run that is heated once, or not at
 * all, if that saves charge as it can be driven. Last, one heating interval that arrives at the target within the
 * limits, if it saves charge, with bev_exchange_heat again.
 *
 * `idle_states` is the unheated run, limits left aside; it and what is written, `states` and `powers_w`, are as
 * of bev_settle. What the plan costs of the charge that must be left is not looked at. `order` is room for
 * `steps` numbers.
 */
bev_status bev_plan_merit_order(const bev_vehicle *vehicle, const bev_trip *trip,
                                const bev_settling *goal, const double *idle_states,
                                double *states, double *powers_w, uint8_t *watched,
                                int32_t *order, double *memory, bev_merit_plan *plan);

/* Memory of bev_heat_early [doubles]; its `watched` are 2 * steps bytes. */
#define BEV_HEAT_EARLY_MEMORY(steps) (3 * (steps))

/*
 * A plan whose last heating interval begins as early as `margin` asks, and ends as soon as it is enough for the
 * target [deg C].
 *
 * `states` and `powers_w`, as of bev_settle, and of `plan` the instant at which heating ends, are a plan. Where
 * `is_changed` (not 0) all of it is written over: limits are left aside where none is active then, else it is the run
 * of bev_drive_as_planned, as where a interval is left out because it is too short, or its heat would come too late.
 */
bev_status bev_heat_early(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                          const bev_uncertainty_margin *margin, double *states, double *powers_w,
                          uint8_t *watched, double *memory, bev_merit_plan *plan,
                          int32_t *is_changed);

/* Memory of bev_unheated_deficit [doubles]; its `flags` are 2 * steps bytes. */
#define BEV_UNHEATED_MEMORY(steps) (9 * (steps) + 4)

/*
 * What a trip lacks that is not heated but with surplus, driven within the limits from a start (two states, or
 * four, as of bev_settle): the most power that the battery cannot deliver [W], and where the charge runs out.
 */
bev_status bev_unheated_deficit(const bev_vehicle *vehicle, const bev_trip *trip,
                              const double *start, double *memory, uint8_t *flags,
                              double *deficit_w, bev_stranding *stranding);

/* Memory of bev_find_surplus_ceiling [doubles]; its `flags` are 2 * steps bytes. */
#define BEV_SURPLUS_CEILING_MEMORY(steps) (13 * (steps) + 8)

/*
 * How warm surplus regeneration is of use by the end of each step of a trip [deg C]: as warm as it takes to arrive at
 * the target without further heating, or as warm as gains energy that the battery's limits would refuse at the states
 * of charge `soc` (steps + 1 values), whichever is warmer, and never near its highest temperature. From a start of two
 * states, or four, as of bev_settle.
 */
bev_status bev_find_surplus_ceiling(const bev_vehicle *vehicle, const bev_trip *trip,
                                    const double *start, double target_c, const double *soc,
                                    double *memory, uint8_t *flags, double *ceiling_c);

/* Why a plan heats less than its target asks for: the charge that must be left, or power that would be lacking. */
typedef enum {
  BEV_NOT_HELD_BACK = 0,
  BEV_BY_RESERVE = 1,
  BEV_BY_POWER = 2
} bev_held_back;

/*
 * What a plan is for, and what it must leave: the target on arrival [deg C], how much warmer than that the battery is
 * to arrive if there is a uncertainty margin [K], and the charge on arrival and on the way.
 */
typedef struct {
  double target_c;
  double margin_k;
  double reserve_soc;
  double lowest_soc;
} bev_safe_goal;

/* What bev_plan_no_regret finds beside the run. */
typedef struct {
  bev_merit_plan plan;
  /* Not 0: no heating that is paid for is better than none, and the run that is written means nothing. */
  int32_t is_unheated;
  /* A bev_held_back. */
  int32_t held_back;
} bev_safe_plan;

/* Memory of bev_plan_no_regret [doubles]; its `watched` has BEV_MERIT_BYTES. */
#define BEV_NO_REGRET_MEMORY(steps) (BEV_MERIT_PLAN_MEMORY(steps) + 8 * (steps) + 4)

/*
 * The plan of bev_plan_merit_order, with `margin` (null: without) that of bev_heat_early, that is no worse than not
 * heating: where it would cost the charge that must be left, or the drive would lack more power, that for the warmest
 * target that does not; where there is none, the same without heating for the sake of climbs.
 *
 * Arguments and what is written are those of bev_plan_merit_order.
 */
bev_status bev_plan_no_regret(const bev_vehicle *vehicle, const bev_trip *trip,
                                const bev_safe_goal *goal, const bev_uncertainty_margin *margin,
                                const double *idle_states, double *states, double *powers_w,
                                uint8_t *watched, int32_t *order, double *memory,
                                bev_safe_plan *plan);

/*
 * The energies of a run that was made with an integrator. Where `columns` is not null, four arrays of `steps`
 * values are written, one after the other, means over each step [W]: Joule heat, leakage (negative where heat
 * is lost; below it, what is taken away to hold the hottest temperature), what the cells give, and what the
 * circuit cannot.
 */
bev_status bev_keep_accounts(const bev_vehicle *vehicle, int32_t integrator, const bev_trip *trip,
                             const bev_run_of_powers *run, double *columns,
                             bev_energies *energies);

/*
 * The instant [s] from which on the heater takes all that the cabin leaves, so that the battery arrives at a
 * target; heat at once, limits left aside. 0 where that is not enough.
 *
 * `idle_soc` and `idle_c` are the unheated run, which arrives below the target. Written are the run, its
 * start included, and what the heater takes in each step [W].
 */
bev_status bev_find_switch(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                           const double *idle_soc, const double *idle_c, double *soc,
                           double *temperature_c, double *heater_w, double *instant_s);

/*
 * The whole plan of a trip on which no limit is active, from a start: the unheated run, where it arrives below
 * the target the switching instant, the run, and what it costs. BEV_LIMITED where a limit is active in the
 * unheated run or in the plan. For a vehicle whose heat arrives at once; one with a heat path is a bad argument.
 * With `margin` (null: without) heating begins early and ends as soon as it is enough. Unless it is to heat
 * `in_one_interval` (not 0), BEV_CHEAPER_ELSEWHERE where bev_heat_cheapest may find a run that costs less.
 *
 * `memory` has BEV_SWITCH_MEMORY(steps) doubles; where the status is not below BEV_OK it begins with the
 * unheated run, charge and temperature at each instant. Written are those of the plan, and what the heater takes
 * in each step [W].
 */
bev_status bev_plan_switch(const bev_vehicle *vehicle, const bev_trip *trip, double start_soc,
                           double start_c, double target_c, int32_t in_one_interval,
                           const bev_uncertainty_margin *margin, double *memory, double *soc,
                           double *temperature_c, double *heater_w, bev_switch_plan *plan);

/*
 * What a watt of the heater in each step of a run does until arrival, arrays of `steps` values: by how much the
 * battery arrives warmer [K/W], and by how much less charge it has then [1/W]; the mean from no heating to all that
 * the cabin leaves. Heat at once, limits left aside.
 */
bev_status bev_find_prices(const bev_vehicle *vehicle, const bev_trip *trip, const double *soc,
                           const double *temperature_c, const double *heater_w,
                           double *warmth_k_per_w, double *charge_per_w);

/* Room that bev_heat_cheapest takes [doubles]. */
#define BEV_CHEAPEST_MEMORY(steps) (6 * (steps) + 2)

/*
 * The run that arrives at the target for the least charge, heat at once, limits left aside: heated in the steps
 * in which a kelvin on arrival costs the least.
 *
 * `soc`, `temperature_c` and `heater_w` are a run that arrives there. Where another one saves something it is
 * written over it, and `orders` says in how many orders of the steps it was found; 0: nothing is written. `memory`
 * has BEV_CHEAPEST_MEMORY(steps) doubles, `order` room for `steps` numbers.
 */
bev_status bev_heat_cheapest(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                             double *soc, double *temperature_c, double *heater_w, double *memory,
                             int32_t *order, int32_t *orders);

/*
 * The whole plan of the paper's heuristic, planned and run by Euler's method: as of bev_plan_switch.
 *
 * BEV_LIMITED where a limit is active in the unheated run, or the plan lacks power or leaves what the model
 * describes.
 */
bev_status bev_plan_paper(const bev_vehicle *vehicle, const bev_trip *trip, double start_soc,
                          double start_c, double target_c, double *memory, double *soc,
                          double *temperature_c, double *heater_w, bev_switch_plan *plan);

/*
 * The instants [s] between which the heater takes all that the cabin leaves, so that the battery arrives at a
 * target for the least energy, heat arriving late, limits left aside. 0 and the arrival where that is not enough.
 *
 * `idle_states` is the unheated run, which arrives below the target; it and `states`, which is written, are as
 * of bev_run_heated. `memory` has BEV_TWO_SWITCHES_MEMORY(steps) doubles. Written is what the heater is told in
 * each step [W], too.
 */
bev_status bev_find_two_switches(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                                 const double *idle_states, double *memory, double *states,
                                 double *command_w, double *on_s, double *off_s);

/* The ways to heat that bev_plan_trips compares. */
typedef enum {
  BEV_UNHEATED = 0,
  /* Below the target with all that the cabin leaves, from the start on, within the limits. */
  BEV_ALWAYS_ON = 1,
  /* From the instant on that the paper's algorithms find, by Euler's method; driven with Runge-Kutta steps. */
  BEV_PAPER = 2,
  /* As bev_plan_switch. */
  BEV_ONE_SWITCH = 3,
  BEV_WAYS = 4
} bev_way;

/* How one way to heat a trip ends: what the heater takes, and the battery on arrival. */
typedef struct {
  double heater_wh;
  double temperature_c;
  double soc;
  /* From this instant on it is heated [s]; NaN where it is not, and where the way has no such instant. */
  double instant_s;
  /* Of this way; the rest means nothing but where it is BEV_OK. */
  int32_t status;
} bev_arrival;

/*
 * Plans many trips of one vehicle, each in BEV_WAYS ways: `arrivals` has count * BEV_WAYS elements, trip by
 * trip. For a vehicle whose heat arrives at once.
 *
 * The steps of the trips lie one after the other in the arrays of `trips`, whose `steps` is their sum;
 * `time_s` is not read, each trip begins at 0 s. Of each trip, arrays of `count`: its steps, the charge and the
 * temperature at its start, its target. A plan leaves `reserve_soc` on arrival and `lowest_soc` on the way. A
 * way is BEV_LIMITED where it does not, or where a limit of the battery is active, which BEV_ALWAYS_ON keeps
 * instead (BEV_EMPTY where the charge runs out). What one trip lacks is said in its statuses only.
 *
 * `memory` has BEV_TRIPS_MEMORY(longest) doubles, `flags` BEV_TRIPS_FLAGS(longest) bytes; a trip of more than
 * `longest` steps is a bad argument.
 */
bev_status bev_plan_trips(const bev_vehicle *vehicle, const bev_trip *trips, int32_t count,
                          const int32_t *steps, const double *start_soc, const double *start_c,
                          const double *target_c, double reserve_soc, double lowest_soc,
                          int32_t longest, double *memory, uint8_t *flags,
                          bev_arrival *arrivals);

#ifdef __cplusplus
}
#endif

#endif /* BEV_PREHEAT_CORE_CORE_H_ */
