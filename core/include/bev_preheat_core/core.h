/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The planner's forward runs in C99: the battery of one vehicle along one trip.
 *
 * The caller provides all memory. No function allocates memory, retains state between calls or changes anything but
 * the outputs that its comment names. Every loop is bounded by BEV_MOST_STEPS, BEV_MOST_AXIS or a number in the
 * code. If a number is not finite, or impossible, the function returns a status below BEV_OK and its outputs are
 * undefined. Units are SI, temperatures are in degrees Celsius, states of charge are 0 ... 1. The reference is the
 * Python package bev_preheat; the model's steps are generated from its equations. Equal inputs give equal bits if
 * the code is compiled with -ffp-contract=off and with the same exp and log.
 */
#ifndef BEV_PREHEAT_CORE_CORE_H_
#define BEV_PREHEAT_CORE_CORE_H_

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Incremented when a struct or a function changes its meaning but not its form. */
#define BEV_INTERFACE 13

/* Maximum number of steps of a trip; if memory is fixed, compile with less: -DBEV_MOST_STEPS=360. */
#ifndef BEV_MOST_STEPS
#define BEV_MOST_STEPS 1000000
#endif
/* States for which curves and limits are evaluated side by side; if stack is scarce, compile with less. */
#ifndef BEV_BLOCK
#define BEV_BLOCK 32
#endif
/* Maximum number of points on a table's axis, and of factors on a curve. */
#define BEV_MOST_AXIS 1024
#define BEV_MOST_FACTORS 4
#define BEV_CURVE_PARAMETERS 5
/* Memory of bev_plan_switch for a trip of `steps` steps [doubles]. */
#define BEV_SWITCH_MEMORY(steps) (8 * ((steps) + 1))
/* Memory of bev_find_two_switches [doubles]. */
#define BEV_TWO_SWITCHES_MEMORY(steps) ((steps) + 1)

typedef enum {
  BEV_OK = 0,
  /* Done; in at least one step the battery cannot deliver the power, and drives with its maximum. */
  BEV_SATURATED = 1,
  /* The charge runs out in a step; later steps are not written. */
  BEV_EMPTY = 2,
  /* The backward run does not meet the unheated run. */
  BEV_NO_CROSSING = 3,
  /* A limit of the battery is active; the outputs are undefined. */
  BEV_LIMITED = 4,
  /* Heating in other steps may cost less; the outputs are undefined. */
  BEV_CHEAPER_ELSEWHERE = 5,
  /* The kept values do not lead to a plan; the outputs are undefined. */
  BEV_LEFT = 6,
  /* A pointer is null, or a count is out of range. */
  BEV_BAD_ARGUMENT = -1,
  /* A number of the vehicle is not finite or impossible. */
  BEV_BAD_VEHICLE = -2,
  /* An input of a step, or a state at the start, is not finite. */
  BEV_BAD_INPUT = -3,
  /* The model's result is not finite. */
  BEV_NOT_FINITE = -4,
  /* A search exceeded its maximum number of rounds, or its memory. */
  BEV_NOT_SETTLED = -5
} bev_status;

/* The integration method. */
typedef enum {
  BEV_EULER = 0,
  BEV_MIDPOINT = 1,
  BEV_RUNGE_KUTTA_4 = 2
} bev_integrator;

/* Formulas of bev_preheat.vehicle.curves, which documents their parameters. */
typedef enum {
  BEV_POLYNOMIAL = 0,
  BEV_POLYNOMIAL_AND_LOGARITHM = 1,
  BEV_INVERSE_TEMPERATURE = 2,
  BEV_TABLE = 3
} bev_curve_kind;

/*
 * A quantity over state of charge and battery temperature: a formula or a table, times factors.
 *
 * In a table, `values[i * temperature_count + j]` belongs to soc[i] and temperature_c[j]. Axes rise; if an axis has
 * one point, the value does not depend on it. Values are interpolated linearly between the points and constant
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

/*
 * One vehicle, as in bev_preheat.vehicle.description. If the heat path's numbers are all 0, heat arrives at once.
 */
typedef struct {
  double capacity_ah;
  double heat_capacity_j_per_k;
  /* Lowest and highest temperature of the battery's range, and the highest temperature in planning [deg C]. */
  double lowest_c;
  double highest_c;
  double hottest_c;
  double heater_efficiency;
  /* Share of the magnitude of the propulsion power that heats the battery. */
  double heat_share;
  double heater_lag_s;
  double coolant_heat_capacity_j_per_k;
  double coolant_conductance_w_per_k;
  /* Of a battery with a shell in the coolant's place: its share of the heat capacity, else 0. */
  double shell_share;
  bev_curve open_circuit_voltage;
  bev_curve resistance;
  /* Least and most power of the cells [W]; charging is negative, discharging positive. */
  bev_curve charge_power_limit;
  bev_curve discharge_power_limit;
} bev_vehicle;

/* Most heat sources of a vehicle, the HVCH included. */
#define BEV_MOST_SOURCES 5

/*
 * The heat sources of a trip: at `temperature_count` temperatures of the battery, at least two, for each step and
 * source the most electrical power [W], and the HVCH power that heats like one watt; linear in between. The first
 * `heating_count` sources heat, the others cool: their HVCH power is below 0. `taken_w` is the cabin's share of each
 * source in each step, more than its power if it may not heat. `steps_w` are its `step_count` powers other than 0,
 * ascending, infinite beyond the last: all infinite, it has any power. `drawing_limit_w` is the most electrical power of all
 * in a step [W], `cold_limit_w` the least heat of all at any temperature, as HVCH power [W].
 */
typedef struct {
  int32_t count;
  int32_t heating_count;
  int32_t temperature_count;
  int32_t step_count;
  const double *temperature_c;
  const double *power_w;
  const double *hvch_watts;
  const double *taken_w;
  const double *steps_w;
  const double *drawing_limit_w;
  const double *cold_limit_w;
} bev_heat_sources;

/*
 * A trip of `steps` steps: arrays of that length, `time_s` one longer. With `sources` (null: the HVCH alone)
 * `heater_limit_w` is the most heat of all at any temperature, as HVCH power.
 */
typedef struct {
  int32_t steps;
  const double *time_s;
  const double *duration_s;
  /* Terminal power, and heat into the battery, without battery heating [W]. */
  const double *idle_power_w;
  const double *power_variance_w2;
  const double *idle_heat_w;
  const double *leakage_w_per_k;
  /* Heater power that the cabin does not need [W]. */
  const double *heater_limit_w;
  const double *propulsion_power_w;
  /* The drivetrain's part of the idle heat [W]. */
  const double *drivetrain_heat_w;
  const double *ambient_temperature_c;
  const bev_heat_sources *sources;
} bev_trip;

/*
 * A run whose energies are computed: states at each instant, and means over each step [W] of the heater's power, of
 * the heat that arrives from the heater (null: all heat, at once), and of the friction brake's power (null: none).
 * `is_deliverable` (not 0): the circuit is known to deliver all power.
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
 * Energies of a run [Wh]. `leakage` is negative if heat is lost; `battery_total` is the energy from the cells,
 * losses included. The power of a lagging heater after arrival is not included.
 */
typedef struct {
  double joule;
  double drivetrain_heat;
  double hvch_heat;
  double leakage;
  double hvch_electric;
  double battery_total;
} bev_energies;

/* The reason for heating; the numbers are those of PreheatPlan.stretch_reason. */
typedef enum {
  BEV_FOR_ARRIVAL = 0,
  /* The battery can then absorb more of the regeneration ahead. */
  BEV_FOR_DESCENT = 2,
  /* The battery can then deliver the power of the climb ahead. */
  BEV_FOR_CLIMB = 3
} bev_reason;

/*
 * Vehicle data of a trip: the leakage as a function of speed, the share of the propulsion power's magnitude that
 * heats the battery, the leakage above which steps must be shorter, the heater's power, the share of the heater's
 * power that the battery may use, and the lag of its heat.
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

/*
 * The plan of bev_plan_switch. Of a plan that does not keep the limits, or does not cost least, only the
 * instant and these three findings are written.
 */
typedef struct {
  /* The switch-on instant [s]; NaN if the plan does not heat. */
  double switching_instant_s;
  double least_soc;
  /* Energy of the heated steps [Wh, electrical]. */
  double interval_wh;
  bev_energies energy_wh;
  /* Whether the unheated run, and the plan, keep the battery's limits. */
  int32_t unheated_keeps_limits;
  int32_t keeps_limits;
  /* Whether heating in other steps cannot cost less. */
  int32_t costs_least;
  int32_t is_heated;
  /* The first heated step, and the step after the last one; both are `steps` if no step is heated. */
  int32_t first_heated;
  int32_t end_heated;
  /* Whether all steps in between are heated, none with surplus; if so, `reason` is the bev_reason. */
  int32_t is_one_interval;
  int32_t reason;
} bev_switch_plan;

/*
 * A digest of BEV_INTERFACE, of all structs, prototypes and memory sizes of these headers, and of the constants shared
 * with Python. A caller that loads the library compares it with its own digest. Sources that are compiled together do
 * not need it.
 */
int32_t bev_interface(void);

/* BEV_OK, BEV_BAD_VEHICLE or BEV_BAD_ARGUMENT. The runs do not check the tables again. */
bev_status bev_check_vehicle(const bev_vehicle *vehicle);

/*
 * Compute the columns of a trip from those of a route. `route` has eight arrays of `steps` values, one after the
 * other: duration, speed, mean and root mean square of the propulsion power, ambient temperature, cabin,
 * auxiliaries, mean magnitude of the propulsion power. `columns` are those of bev_trip in their order: time_s with
 * steps + 1 values, and nine with `steps`. A step that is too long for the integrators is a bad input.
 */
bev_status bev_make_trip(const bev_trip_terms *terms, int32_t steps, const double *route, double *columns);

/*
 * Run the model over a trip from step `first` on, ignoring limits; heat arrives at once.
 *
 * `heater_w` and `brake_w` are powers in each step of the whole trip [W]; null: none. soc[first] and
 * temperature_c[first] are the start; the values from first + 1 to `steps` are written.
 */
bev_status bev_run(const bev_vehicle *vehicle, int32_t integrator, const bev_trip *trip, int32_t first,
                   const double *heater_w, const double *brake_w, double *soc, double *temperature_c);

/*
 * The same with the heat path, from the start on: `command_w` is the heater's command, and `states` are four arrays of
 * steps + 1 values, one after the other: charge, temperature, heater power [W], coolant excess [K]. `heat_w` are two of
 * `steps`, the means of the heater's power and of the heat that reaches the battery [W]; null: they are not asked for.
 */
bev_status bev_run_heated(const bev_vehicle *vehicle, const bev_trip *trip, const double *command_w,
                          double *states, double *heat_w);

/*
 * The least and the most terminal power [W] of steps within the battery's limits at both ends: `soc` and `temperature_c` have one value more than
 * there are steps, the other arrays one for each step.
 */
bev_status bev_limits_of_steps(const bev_vehicle *vehicle, int32_t steps, const double *soc,
                               const double *temperature_c, const double *variance_w2, double *least_w,
                               double *most_w);

/* The step in which a run's charge runs out (-1: it does not), and the share of this step that is driven. */
typedef struct {
  int32_t step;
  double driven_share;
} bev_stranding;

/*
 * The run within limits under heater commands [W], in steps that begin colder than `below_c` [deg C]. With
 * `takes_surplus` (not 0) regeneration beyond the charge limit goes to the heater before it goes to the brake. If the
 * charge runs out, the vehicle stands. `states`, whose first values are the start, are two arrays of steps + 1 values,
 * charge and temperature, `powers_w` two of `steps`, heater and friction brake [W]; with a heat path four each, states as
 * in bev_run_heated, and means of command, friction brake, heater power, and heat into the battery [W]. `flags` has 2 * steps bytes of memory.
 */
bev_status bev_drive_as_planned(const bev_vehicle *vehicle, const bev_trip *trip, const double *command_w,
                                double below_c, int32_t takes_surplus, double *states, double *powers_w,
                                uint8_t *flags, bev_stranding *stranding);

/*
 * The requirements on a plan: least and most temperature on arrival [deg C] (INFINITY: any), and the state of charge
 * that heating does not cost.
 * `direction`: 1 if the vehicle heats before the trip, -1 if it cools, else 0. `deviation_k`: standard deviation of the arrival [K], of what
 * becomes known on the way; 0: the drive goes as forecast. `price` (null: 1 everywhere) are `steps` factors of the
 * battery energy, such as prices of energy from the grid as shares of the highest.
 */
typedef struct {
  int32_t direction;
  double target_c;
  double most_c;
  double lowest_soc;
  double deviation_k;
  const double *price;
} bev_value_goal;

/*
 * Most temperatures of an instant. Memory of bev_plan_by_values: doubles if it keeps the values of all instants, doubles
 * if it keeps those of every 16th, and bytes.
 */
#define BEV_VALUE_POINTS 128
#define BEV_VALUE_KEPT_EVERY 16
#define BEV_VALUE_MEMORY(steps) (279 * (steps) + 272)
#define BEV_VALUE_SPARING_MEMORY(steps) (39 * (steps) + 4112)
#define BEV_VALUE_BYTES(steps) (4 * (steps))

/*
 * The run within limits with the least battery energy, from the value of a temperature at each instant.
 *
 * `states` are four arrays of steps + 1 values (charge, temperature, heater power, coolant excess), whose first
 * values are the start; `powers_w` are four of `steps` (command, friction brake, heater power, heat into the
 * battery). `flags` has BEV_VALUE_BYTES bytes. `ends_in` becomes the step within which heating ends (on, then off), or
 * -1. BEV_EMPTY: the charge does not carry the trip without paid heat.
 *
 * `kept_every`: 1 keeps the values of all instants. A larger number keeps those of every such instant and computes the
 * others twice; the plan is the same. `memory` has BEV_VALUE_MEMORY doubles; with BEV_VALUE_KEPT_EVERY
 * BEV_VALUE_SPARING_MEMORY are enough.
 */
bev_status bev_plan_by_values(const bev_vehicle *vehicle, const bev_trip *trip, const bev_value_goal *goal,
                              double *states, double *powers_w, uint8_t *flags, double *memory, int32_t *ends_in,
                              int32_t kept_every);

/*
 * The plan for the rest of a trip, from the values of a plan that was made earlier: only the forward pass.
 *
 * `flags` and `memory` are those of bev_plan_by_values for a trip of `kept_steps` steps, with `kept_every` 1 and the
 * same goal. Its last `trip->steps` steps are those of this trip, whose first step may be shorter. BEV_LEFT: there are
 * no such values (the drive was certain, or heating left charge or power short), they now lead to that, or the run
 * lies more than 1.5 K from the middle of the temperatures that have values. The other arguments are as above.
 */
bev_status bev_follow_values(const bev_vehicle *vehicle, const bev_trip *trip, const bev_value_goal *goal,
                             int32_t kept_steps, double *states, double *powers_w, uint8_t *flags, double *memory,
                             int32_t *ends_in);

/*
 * The energies of a run that was made with an integrator. If `columns` is not null, four arrays of `steps` values
 * are written, one after the other, means over each step [W]: Joule heat, leakage (negative if heat is lost; it
 * includes the heat that is removed at the hottest temperature), power of the cells, and power that the circuit
 * cannot deliver.
 */
bev_status bev_keep_accounts(const bev_vehicle *vehicle, int32_t integrator, const bev_trip *trip,
                             const bev_run_of_powers *run, double *columns, bev_energies *energies);

/*
 * The plan that is switched on once, from a start: the unheated run and, if it arrives below the target, the switching
 * instant and the run; both without regard to limits. `plan` has whether they keep them, and the energies of a plan
 * that does. Heat must arrive at once; a vehicle with a heat path is a bad argument. Unless `in_one_interval` is not 0,
 * the plan is also compared with heating in other steps (`costs_least`).
 *
 * `memory` has BEV_SWITCH_MEMORY(steps) doubles; it begins with the unheated run, charge and temperature at each
 * instant. The plan's charge and temperature are written, and the heater's power in each step [W].
 */
bev_status bev_plan_switch(const bev_vehicle *vehicle, const bev_trip *trip, double start_soc, double start_c,
                           double target_c, int32_t in_one_interval, double *memory, double *soc,
                           double *temperature_c, double *heater_w, bev_switch_plan *plan);

/*
 * The instants [s] between which the heater takes all power that the cabin leaves, so that the battery arrives at a
 * target for the least energy; heat arrives late, limits are ignored. 0 and the arrival if that is not enough.
 *
 * `idle_states` is the unheated run, which arrives below the target; `idle_states` and the output `states` are as
 * in bev_run_heated, as is `heat_w`. `memory` has BEV_TWO_SWITCHES_MEMORY(steps) doubles. The heater's command in each
 * step [W] is written, too.
 */
bev_status bev_find_two_switches(const bev_vehicle *vehicle, const bev_trip *trip, double target_c,
                                 const double *idle_states, double *memory, double *states, double *command_w,
                                 double *heat_w, double *on_s, double *off_s);

#ifdef __cplusplus
}
#endif

#endif /* BEV_PREHEAT_CORE_CORE_H_ */
