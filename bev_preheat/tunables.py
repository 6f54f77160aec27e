# SPDX-License-Identifier: Apache-2.0
"""
The numbers of the planner's step: times, thresholds, spreads, prices and tolerances, a row each.

A row: name, value, `#` unit (1: a ratio, n: a number of them, sd: standard deviations), `|` reason, `|` by how
much the arrival of a drive moves at most if the number is 30 % smaller or larger, in the drive of
`python3 -m bev_preheat_studies.tunables`. Rows without the last move nothing there, or the C core has them built
in. `…` goes on with the row above.

Sizes, formats and units stand where they are used, spreads of the estimator's whole state in
`estimation/belief.py` and `prior.py`, and what an integrator sets in `control/settings.py`. The C core takes its
numbers from here, too (`vehicle/core_interface.py`).
"""


# Signals: does a reading belong to this battery?

# estimation/signal_checks.py: one battery on the topic
OTHER_PACK_K = 4.0        # K   | one battery does not change by more between two states
OTHER_PACK_SOC = 0.03     # 1   | nor by more of its charge, with a correction of the display
OTHER_PACK_VOLTAGE = 0.2  # 1   | nor by more of its voltage, under a step of the load
PACK_RATE_K_PER_S = 0.1   # K/s | fastest change of a pack: for readings far apart
COMPARED_STATES = 20      # n   | the latest ones: LEAST_JUMPS begin the doubt, none ends it
LEAST_JUMPS = 3           # n   | one outlier and its way back are two jumps
SLOW_GAPS = 2             # n   | in a row make a feed slow, as many in time steady: one may be a network's

# estimation/temperature_check.py: the reading follows the battery
STUCK_K = 3.0              # K | expected change without a movement; the model errs by less
STUCK_LAGS_S = 120.0       # s | of a change: heater and sensor lag behind by this together
STUCK_BESIDE_LAGS_K = 1.5  # K | added to the lags
STUCK_WITHIN_S = 900.0     # s | a slower change may be an error of the model's leakage
UNMOVED_K = 0.05           # K | half of the finest step in use
BELOW_AMBIENT_K = 20.0     # K | no car cools its battery further below ambient
COLDEST_IN_SUMMER_C = 5.0  # °C | of a battery from a cool garage, however hot it is outside

# estimation/signal_checks.py: voltage and charge are this battery's
VOLTAGE_WITHIN = 0.2   # 1 | share of the open-circuit voltage, and R I once more; vehicle files differ from cars
EMPTY_BELOW = 0.001    # 1 | a charge that was never set reads 0
FULLER_SOC = 0.2       # 1 | charge whose voltage, halfway, contradicts an empty battery
SCALE_HOLDS_S = 600.0  # s | a percentage has the scale of the one before for this time
GOES_ON_WITHIN = 0.1   # 1 | change of the charge that continues the last valid value

# estimation/current_check.py: sign and scale of the current
CURRENT_CHANGES = 60            # n   | of voltage and current that are correlated: a minute of a usual feed
LEAST_CURRENT_CHANGES = 20      # n   | a correlation of fewer is chance
CHANGE_WITHIN_S = 2.5           # s   | between the states of a change: open-circuit voltage moves more slowly
LEAST_DEVIATION_A = 5.0         # A   | of few changes: below it, noise of the sensors correlates
LEAST_DEVIATION_OF_ALL_A = 1.5  # A   | of CURRENT_CHANGES changes; offsets of sensors are smaller, too
ZERO_AFTER_S = 2.0              # s   | 0 A sooner after another current is a field that is not filled
PROVES_CORRELATION = 0.7        # 1   | measured drives show -0.99
LEAST_MOVED = 0.0025            # 1   | of the charge, shows a direction: above the noise of displays
LEAST_MOVED_STEPS = 0.9         # n   | … in steps of the charge's signal, less rounding
LEAST_MOVED_DEVIATIONS = 5.0    # sd  | … of its noise: chance in one of a million
SOC_NOISE_OVER = 30.0           # n   | over which the noise of the charge is averaged
MOST_SOC_NOISE = 0.01           # 1   | larger changes are corrections, not noise
LEAST_CURRENT_SHARE = 0.25      # 1   | of a change of the charge that the current must account for
SIGN_CONFIRMED_EVERY_S = 10.0   # s   | a sign proved right is looked at again; saves time
SOC_JUMP_STEPS = 2.5            # n   | of the charge's signal at once: a correction
SOC_JUMP_MOVED = 3.0            # 1   | … as are so many times the charge that the current moved
SIGN_RESTART_AFTER = 0.05       # 1   | charge moved without a proof: the comparison starts again
SCALE_FACTOR = 3.0              # 1   | capacities and displays differ by tens of per cent, units by tens
SCALE_LEAST_CHANGE = 0.02       # 1   | of the charge that is compared: ten times its error
SCALE_LEAST_STEPS = 4.0         # n   | … in steps of its signal
SCALE_ERROR = 0.002             # 1   | of a change of the charge
SCALE_ERROR_STEPS = 2.0         # n   | … in steps of its signal: one at each end
SOC_JUMP = 0.01                 # 1   | change from one state to the next that is a correction
SOC_JUMP_PER_S = 1.0 / 600.0    # 1/s | … and for each second between: six times the capacity an hour
LONGEST_COMPARED_S = 3600.0     # s   | a small current that is not measured adds up
LOWEST_SHOWN_SOC = 0.01         # 1   | displays stay at 0 while charge flows
HIGHEST_SHOWN_SOC = 0.99        # 1   | displays stay at 100 % while charge flows
SIGNAL_DOUBT_SHOWN_S = 30.0     # s   | a doubt about voltage or current is shown after its last reading
WIDEST_CELL_SPREAD_K = 10.0     # K   | cells of a healthy battery differ by less, heated or not
MISSING_CELL_C = (0.0, -40.0, -50.0)  # degC | read by modules that are not there: 0, or a byte 0 with its offset
COLDER_CELL_K = 20.0            # K   | a cell that is colder than the battery by more is a failed sensor


# Estimation: the evidence of readings

# estimation/estimate.py, belief.py: noise of the model
NOMINAL_HEAT_LAG_S = 40.0        # s    | heater to cells, whose logarithm is 0 | 0.181 K
OUTSIDE_LAG_S = 80.0             # s    | most in heater and coolant; 40: a car with coolant arrives 1.7 K too cold
UNSEEN_SHELL_RISE = 4.0          # K/K  | over its heat under way, of a shell that no sensor shows: a quarter
NOMINAL_SENSOR_LAG_S = 20.0      # s    | cells to sensor, whose logarithm is 0
LOCAL_LAG_S = 100.0              # s    | of local heat at the sensor; nine i3 drives: 60 … 150 s predict alike
LOCAL_DEVIATION_K = 0.15         # K    | local rise without heat; nine i3 drives: 0.1 … 0.2 K predict alike
JOULE_RISE_NOISE_K_PER_KW = 1.0  # K/kW | rise by Joule heat; nine i3 drives: 0.8 … 1.2 predict alike
UNKNOWN_K = 0.5                  # K    | after a gap: heat under way, battery minus sensor, local rise
MOST_APART_K = 60.0              # K    | battery minus sensor at most, and heat under way: behind a poor contact
SIGNAL_NOISE_K = 0.2             # K    | of the temperature signal before it is rounded
SOC_NOISE = 0.001                # 1    | of the charge's signal beside its steps
POWER_NOISE = 0.3                # 1    | relative error of the route's power: traffic, wind, load | 0.185 K
NOISY_FROM_W = 3000.0            # W    | least power to which POWER_NOISE applies
POWER_NOISE_LASTS_S = 60.0       # s    | correlation time of POWER_NOISE | 0.185 K
CLIPPED_DEVIATIONS = 2.5         # sd   | readings further off are clipped here: outliers are not normal
MOST_EVIDENCE = 1.0              # nats | of one reading against a hypothesis: one outlier does not decide
LEAST_VARIANCE = 1e-12           # K2   | rounding may make a variance slightly negative
LEAST_WEIGHT = 1e-12             # 1    | of a hypothesis, so that it can recover
LOST_PLACE = 0.2                 # 1    | … of a place of the sensor, below which it begins each trip afresh

# estimation/estimator.py, readings.py: readings that count
LEAST_INTERVAL_S = 0.95       # s  | faster readings are correlated: one a second, less jitter
LONGEST_BELIEF_STEP_S = 10.0  # s  | longest step of the belief: a quarter of the heat's lag
LONGEST_GAP_S = 60.0          # s  | states further apart do not follow one another
READING_NOISE_K = 0.3         # K  | of a single temperature, while it is unknown
READING_NOISE_SOC = 0.005     # 1  | of a single charge, while it is unknown
LEAST_SOC_DEVIATION = 0.01    # 1  | … in checks of its plausibility: displays are corrected
MOST_OTHER_POWER_W = 20e3     # W  | cabin and auxiliaries at most: more battery power is implausible
DIVERGED_K = 50.0             # K  | a larger deviation of the temperature: the belief has diverged
SINGLE_PRECISION = 1e-3       # 1  | messages preserve multiples to this share of a step
IMPLAUSIBLE_DEVIATIONS = 6.0  # sd | further off is rejected until it has lasted
EXCURSION_DEVIATIONS = 3.0    # sd | from here on a temperature leaves what is expected | 0.086 K
RETURN_DEVIATIONS = 1.5       # sd | … and from here on it is back
LARGEST_EXCURSION_K = 3.0     # K  | contacts and wires fail by this; more is another battery
LONGEST_EXCURSION_S = 150.0   # s  | contacts and wires fail for this long; no battery warms as fast
LONGEST_SPIKE_S = 30.0        # s  | of more: a bus that fails for a moment; another battery stays
COUNTED_READINGS = 300        # n  | the latest ones in the share of ignored ones

# estimation/hypotheses.py: a heater that has failed
FAILURE_S = 200.0 * 3600.0    # s    | mean driving time between failures of a heater; assumed
REPAIR_S = 50.0 * 3600.0      # s    | … until it recovers; assumed
FAULTY = 0.0025               # 1    | share of heaters that failed before the first drive; assumed
SUSPECT_FROM = 0.5            # 1    | probability of a fault that makes it suspect
UNHEATED_S = 600.0            # s    | after heating, from which a heater that is off tells nothing
SUSPECT_SAID_S = 60.0         # s    | … for which it is suspect before the plan's sentence says so
TOLD_FROM = 0.995             # 1    | … that is reported: by its own account wrong once in 200
NAMED_FROM = 0.95             # 1    | … of one heat source's, to name it once a fault is certain
TAKEN_BACK_BELOW = 0.2        # 1    | … below which the report is withdrawn
TIMES_AS_LIKELY = 3.0         # 1    | … of another fault, to replace the reported one
LEAST_COURSE_K = 3.0          # K    | missing heat that spikes, hysteresis and a second mass do not reach
LEAST_COURSE_S = 300.0        # s    | … for this long
ERROR_LASTS_S = 10.0          # s    | a model's error: readings within are one for a heat source against another
MOST_NATS = 50.0              # nats | of the evidence for one heat source against another, for exp
TRIED_FROM = 0.2              # 1    | probability that a source is weak, from which it is switched off to tell
TRIED_OFF_K = 1.0             # K    | … for the time of this heat: several times LOCAL_DEVIATION_K
SHARE_STEPS = 4               # 1    | shares of a derated heat source that plans know: each needs plans of its own
LEAST_RISE = 0.4              # 1    | share of uncommanded heat seen: leakage takes a third, a spike falls back
OTHERS_ERROR = 0.3            # 1    | of the heat of other sources: so far off are tables of heat pumps; assumed
NO_CONTRADICTION = -2.0       # nats | the battery's power does not speak against the fault
LEANING = 0.6931471805599453  # nats | ln 2: the battery's power makes the fault twice as likely
LEANING_COURSE_K = 2.0        # K    | missing heat that is enough then
LEANING_COURSE_S = 120.0      # s    | … for this long

# estimation/measured_power.py: the battery's power shows the heater
VARIATION_S = 40.0         # s    | over which the power's variance is taken: a segment of a route
POWER_BLOCK_S = 30.0       # s    | over which power is averaged: above heater ramps, below a heating interval
EXCESS_W = 1200.0          # W    | beyond the route and its consumption: traffic, other consumers
CONSUMPTION = 0.04         # 1    | of the route, off by: with EXCESS_W 1.4 kW in all at 20 kW
ROAD_LASTS_S = 600.0       # s    | until the road changes: correlation of excess, scatter and variance
SCATTER_W = 2500.0         # W    | from block to block, a first guess
SCATTER_BLOCKS = 2.0       # n    | that the first guess counts for
CORRELATED = 1.5           # 1    | neighbouring blocks are, so differences show less than the scatter
LEAST_SCATTER_W = 300.0    # W    | other consumers and sensors
MOST_BLOCK_EVIDENCE = 3.0  # nats | of one block: one outlier does not decide
FREEDOM = 4.0              # n    | degrees of freedom of Student's t: traffic makes large errors likely

# estimation/prior.py, state_file.py, control/learning.py: before the first reading
LAG_DEVIATION = 1.0                  # 1 | of a lag's logarithm, for a file without lags | 0.029 K
DESCRIBED_LAG_DEVIATION = 0.5        # 1 | … and with lags: coolant flow depends on the pump
DESCRIBED_PLACE_DEVIATION = 0.2      # 1 | of the sensor's place of `thermal`, over its distance to the mean
SHELL_LAG_DEVIATION = 0.25           # 1 | … and between shell and core: of a uniform spread of +-40 %
EXCESS_DEVIATION = 0.25              # 1 | of the heat under way after a gap, of itself: as of its lag
OVERNIGHT = 0.01                     # 1 | deviation of each logarithm: a car changes slightly
PARKED_WARMER_K = 10.0               # K | over ambient at parking: stood outside … fast charged; assumed
PARKED_DEVIATION_K = 10.0            # K | its standard deviation; assumed
KNOWN_PARKED_DEVIATION_K = 1.0       # K | of one seen before parking: cells and housing differ; assumed
AMBIENT_DEVIATION_K = 1.5            # K | of the route's ambient temperature where the car stood; assumed
OFFSET_DEVIATION_K = 1.5             # K | of the offset of temperature sensors; assumed
ELSEWHERE_SHARE = 0.1                # 1 | cars that stood in a garage, or were charged or preheated; assumed
ELSEWHERE_WITHIN_K = 40.0            # K | range of their batteries; assumed
KNOWN_TIME_CONSTANT_DEVIATION = 0.3  # 1 | of its logarithm: wind, garage and coolant decide; assumed
UNMEASURED_LEAKAGE_DEVIATION = 0.8   # 1 | … of an assumed leakage: packs are nearly insulated … bare
LONGEST_STAND_S = 1e7                # s | longer standing times count as this: by then a battery is as the air
PARKED_WITHIN_S = 900.0              # s | a temperature so long before or after parking is the parked battery's
NOTED_EVERY_S = 300.0                # s | temperatures are noted
MOST_NOTED = 576                     # n | two days of them
CONTRADICTS_BEYOND_K = 2.0           # K | sensor against standing time, beside a deviation

# estimation/forecast.py: how well the arrival is known
SETTLED_K = 0.25                       # K  | least deviation once heating has ended: readings go on until then
UNMODELLED_K = 0.2                     # K  | other masses, other places of the sensor
UNDESCRIBED_SHARE = 0.15               # 1  | … without `thermal`, of the shell's excess: 40 simulated drives
UNSEEN_LAG_S = 150.0                   # s  | … of a shell that no reading shows
UNSEEN_SHARE = 0.25                    # 1  | … of its heat on arrival, which the sensor shows: 55 simulated drives

# estimation/before_restart.py: what outlasts the process
OLDEST_CHOICE_NS = 86_400_000_000_000  # ns | a day: by then the driver has forgotten it
JUST_BEGUN_NS = 60_000_000_000         # ns | a route plan that is older than a minute begins no trip
NOWHERE_M = 100.0                      # m  | a route no longer than an error of positions leads nowhere


# Control: regime, place, doubt

# control/regime.py: driving, standing, charging; nine winter drives (10 300 s) of an i3
CHARGING_AFTER_S = 9.0             # s  | regeneration never stayed within a tenth for so long
LEAST_CHARGING_STATES = 3          # n  | a regime is not recognised from one state
CHARGING_DOUBTED_AFTER_S = 2.0     # s  | learning pauses until the regime is clear
CHARGES_W = 1000.0                 # W  | into the battery in each state
STEADY_SHARE = 0.1                 # 1  | of the mean power: chargers are steady
STEADY_W = 600.0                   # W  | … or within this: the car's consumers vary
BEYOND_REGENERATION = 2.0          # 1  | times the regeneration that the route plans: charging exceeds it
BEYOND_REGENERATION_W = 2000.0     # W  | … and by this
STANDING_AFTER_S = 60.0            # s  | of low power, or at one place: a stop of a minute is part of the route
STANDING_AFTER_LONG_S = 300.0      # s  | … or this long, where the route may plan a slow stretch
PARKED_AFTER_S = 120.0             # s  | … or this long, with the consumers off
DRIVES_W = 2000.0                  # W  | least power of the route where the car should drive
ROAD_SHARE = 0.5                   # 1  | of the route's power: consumers of a car that stands take less
STANDS_WITHIN_W = 1000.0           # W  | by which a standing car exceeds consumers and heater at most
STANDS_ABOVE_W = -500.0            # W  | more power into the battery is regeneration
PARKED_SHARE = 0.5                 # 1  | of the route's consumers: the car is off
NOT_PARKED_SHARE = 0.8             # 1  | … and on again
DRIVING_AFTER_S = 3.0              # s  | above consumers and heater: it drives again
HEATER_FOLLOWS_S = 120.0           # s  | heaters ramp up, and lag by up to 90 s
MIRRORED_UP_TO = 1.4               # 1  | of the route's power: all that a reversed current shows
SHORT_GAP_S = 30.0                 # s  | states further apart are not of one course of the power
UNPLUGGED_AFTER_S = 20.0           # s  | unplugging takes longer; shorter charging is a descent
ARRIVES_AFTER_S = 120.0            # s  | charging near the end of a leg: the car is at the charger
FROZEN_AFTER_S = 300.0             # s  | a position, or all values, that stay while the battery drives
NEAR_END_S = 900.0                 # s  | … near in time
NEAR_END_SHARE = 0.25              # 1  | … or by share of the leg
NEAR_START_SHARE = 0.25            # 1  | … but not here: it may charge until departure
ASSUMED_FROM_NS = 300_000_000_000  # ns | five minutes, whose mean power is assumed to go on
STANDING_W = 500.0                 # W  | mean and scatter of the power of a car that stands

# control/charge_course.py: the same from the state of charge alone; assumed
CHARGE_COURSE_S = 2400.0           # s | of charges that are compared with the route
CHARGE_EVERY_S = 15.0              # s | apart
RISES_WITHIN_S = 300.0             # s | a car that is charged fast gains LEAST_CHARGED
LEAST_CHARGED = 0.03               # 1 | of the charge, beyond descents: 5 min of 8 % on no map give 0.02
CHANGED_CHARGE = 0.005             # 1 | … and learning pauses; a fall by CHANGED_CHARGE ends charging and standing
LEAST_TAKEN = 0.015                # 1 | of the charge that the route takes: a descent on no map is shorter
STANDS_SHARE = 0.25                # 1 | … and a car that stands takes less of this
ESTIMATORS_EVERY_S = 600.0         # s | between estimators, to forget values learned of a car that was not driven
ESTIMATORS_KEPT = 3                # n | … of 20 min; a coarse charge shows a stand after up to half an hour

# control/timetable.py, expected_drive.py: where on the route
KNOWN_TO_M = 10.0                       # m  | accuracy of a distance: within it the car is on time
CORRECTED_BY_M = 100.0                  # m  | positions are corrected by up to this
END_KNOWN_TO = 0.01                     # 1  | share of the route: chargers lie off the road
MOST_REPLACED = 100                     # n  | replaced route plans of a trip whose stamps are remembered
PACE_OVER_NS = 5_000_000_000            # ns | five seconds of the pace are averaged
MOVES_WITHIN_NS = 10_000_000_000        # ns | ten seconds without moving KNOWN_TO_M: it stands
AROUND_NS = 60_000_000_000              # ns | the place is uncertain: power of a minute around it counts
AROUND_SHARE = 0.05                     # 1  | … growing with the time since departure: traffic
MOST_AROUND_S = 300.0                   # s  | … to this
LOOKED_UP_NS = 15_000_000_000           # ns | step of this look in time
FACTOR_STEP = 0.05                      # 1  | of a factor's deviation that rebuilds the vehicle: saves time
LAG_STEP = 0.05                         # 1  | of the logarithm of the heat's lag that does the same
COMPARED_EVERY_S = 5.0                  # s  | between two comparisons of model and sensor: saves time
SEEN_OVER_S = 60.0                      # s  | over which the heater's power is averaged from the battery's
CONFIRMED_WITHIN_S = 3.0                # s  | until an answer of 0 W is a refusal: answers take a moment
REFUSED_S = 120.0                       # s  | … which holds this long without a command: no flicker
RESTING_W = 100.0                       # W  | its electronics and the offset of its measurement are no heat
COMPARED_OVER_NS = 60_000_000_000       # ns | a minute over which answer and battery power are compared
LEAST_DIFFERENCE_W = 500.0              # W  | … and by which they must differ for a doubt


# Control: from a plan to the heater

# control/forecast_plan.py, command.py, heater_switch.py, inbox.py: uncertainty, hysteresis, doubt
LEAST_REVEALED_K = 0.02       # K   | of the arrival's deviation becomes known on the way, at least
MOST_REVEALED_K = 3.0         # K   | … at most
LAG_REVEALED_S = 300.0        # s   | of heating that reveals the heater's lag: chosen on preheat robustness
HELD_ABOVE_TARGET_K = 1.0     # K   | for its least time on the heater heats this far at most
HELD_BELOW_HIGHEST_K = 3.0    # K   | … and stops so far below the battery's range
LEAST_STATUS_S = 10.0         # s   | a new status is shown once it has held: plans lie on either side of a bound
HELD_OFF_S = 10.0             # s   | without doubt, after doubt interrupted heating
HELD_OFF_AGAIN_S = 60.0       # s   | … if it had interrupted it before
AGAIN_WITHIN_S = 90.0         # s   | … within this
MOST_SWITCH_ONS = 20          # 1/h | whatever the inputs: it spares the contactor; the second half comes evenly
LEAST_HELD_S = 2.0            # s   | a state holds for twice the period of a usual feed: stamps are coarse
CLOCK_RESTART_S = 1.0         # s   | networks reorder states by less; a clock that falls back by more was set
MOST_STANDING_S = 900.0       # s   | of standing without a stop of the route: heating ends
MOST_PARKED_S = 180.0         # s   | … with the consumers off
FORESEEN_S = 1800.0           # s   | a later trip raises no alarm: the battery may be charged until then

# control/preparation.py, departure_source.py, planning/full_power.py: a battery that is ready at an instant
LONGEST_SOONEST_S = 6 * 3600.0            # s  | heating as soon as possible ends
OBSTACLE_ENDS_GOAL_S = 60.0               # s  | an obstacle that lasts ends the goal
SOONEST_WITHIN_K = 0.1                    # K  | of the target counts as reached
CHARGE_FALLS_BY = 0.02                    # 1  | of a car that is plugged in; if more, it is not
FURTHEST_GOAL_S = 24 * 3600.0             # s  | a goal's instant lies at most a day ahead
AMBIENT_KNOWN_S = 6 * 3600.0              # s  | weather changes
AIMS_BELOW_K = 0.05                       # K  | of the target, so that rounding does not put off the start
SPARES = 1e-4                             # 1  | charge above the reserve, for the same reason
BEGINS_S = 6 * 3600.0                     # s  | a departure becomes a goal this long before
BEGINS_WITH_PRICES_S = 12 * 3600.0        # s  | … for the cheap hours of a night
RETRY_S = 300.0                           # s  | a refused or lost goal is wanted again
EARLIEST_NS = 1_577_836_800_000_000_000   # ns | a clock before 2020 was never set
FURTHEST_SKIP_NS = 1_296_000_000_000_000  # ns | 15 days: a longer skip, or absence, comes from a wrong clock
PLANNING_STEP_S = 30.0                    # s  | longest step of the time until a departure

# control/target_choice.py, target.py, charger_heat.py: what pays
FIRST_LOOK_K = 5.0        # K | between the targets of the first look, and above the usual one
LEAST_GAIN_SHARE = 5e-4   # 1 | of the cost, for another target: less is jitter
MOST_MOVE_K = 2.0         # K | a search; the heater warms by less in its time, so nothing is missed
SAME_ARRIVAL_S = 1800.0   # s | a route plan with charger and arrival like this has the same destination
SEARCH_PERIOD_S = 600.0   # s | until the target, or heating at a charger, is chosen again
LEAST_PERIOD_S = 60.0     # s | … or this, if route plan, probability of charging or heater changed
BEGINS_BELOW_K = 1.0      # K | of the temperature that pays: the heater is not switched for less
CHANGED_POWER = 0.1       # 1 | share of the charger's power whose change asks for another choice
CHARGER_RAMP_S = 20.0     # s | … but not sooner: chargers ramp up
LIMITING_SHARE = 0.9      # 1 | of its limit, from which the battery limits the power
USUAL_PAYS_FROM = 0.5     # 1 | probability of charging; for a car whose sessions are unknown
MOST_PLANNED_STEPS = 360  # n | a plan of more delays the next command
MOST_STOPS = 20           # n | all legs are planned when a route arrives


# Planning: costs and tolerances

# planning/planner.py: what counts
SHORTFALL_TOLERANCE_K = 0.2  # K  | the paper's Euler steps are not more accurate
SOC_TOLERANCE = 1e-5         # 1  | on the reserve of charge
SAME_SOC = 5e-4              # 1  | runs by Euler and by Runge-Kutta differ by less
SAME_POWER_W = 0.1           # W  | heater and brake take the same within the limits
NOW_S = 1e-6                 # s  | a switching instant this close is now
LEAST_PRICE_SHARE = 1e-3     # 1  | of the highest price, for energy that is free: none is wasted
LEAST_TOLD_S = 0.5           # s  | a route that starts within this starts now
RESOLUTION_K = 0.05          # K  | of what would change a plan, and of arrivals as text
LEAST_TOLD_WH = 0.05         # Wh | a change of the energy that is worth words
MOST_EXCESS_K = 150.0        # K  | coolant over battery: more is implausible
WIDEST_FORECAST_K = 10.0     # K  | a larger deviation is no forecast
COLDER_BY_K = 5.0            # K  | a battery this much colder meets a limit: it is near
PAUSE_FACTOR = 10.0          # 1  | times the duration of a late answer: a slow method leaves the processor
VALUES_KEPT_S = 60.0         # s  | of the drive, for which a value function holds
MOST_CHANGED_SHARE = 0.05    # 1  | of the largest power, by which the drive may have changed
MOST_DEVIATION_SHARE = 0.25  # 1  | … and the uncertainty
TARGET_HALVINGS = 14         # 1  | of the range in which the warmest target is searched
REFINED_MINIMA = 3           # n  | of a grid's lowest minima are refined

# planning/dynamics.py: the model
HOTTEST_BEYOND_RANGE_K = 20.0  # K | the car's own cooling, not in the model, holds the battery
LONGEST_STEP_S = 300.0         # s | Euler's error grows with the step
LONGEST_ROW_S = 60.0           # s | longer rows of a given route are divided: 300 s cost 0.1 % of the heat
TIME_CONSTANT_SHARE = 0.5      # 1 | explicit methods become unstable at twice the time constant
LAGS_AHEAD = 5.0               # n | after which a heater that is off takes nothing: e^-5
LASTING_LAGS = 0.7             # n | of surplus that is worth using: ln 2, heat is worth half its cost
TOO_LATE_LAGS = 12.0           # n | before arrival; later heat is for the arrival
WARMER_K = 0.5                 # K | no plan arrives this much above target and margin
BELOW_HIGHEST_K = 5.0          # K | surplus stops heating so far below the battery's range
HEATING_SHARE = 1e-4           # 1 | of the power that the cabin leaves: less is rounding

# planning/value_*.py, recursion.py: the value function
SHORT_PRICE = 30.0              # 1  | of a missing kelvin, in energies that heat it: no plan saves there
BEYOND_PRICE = 0.5              # 1  | of a kelvin beyond a pass
LEAST_MIXED_SHARE = 0.1         # 1  | of the next end's power in a mixture: no heater stays on with little
MOST_SPREAD = 0.9               # 1  | of values at once, in distances squared: stable below 1
SWITCH_ON_WH = 0.5              # Wh | no plan switches for less
SWITCH_ON_EXPECTED_WH = 60.0    # Wh | … where each update may switch: chosen on preheat robustness
HEATING_PRICE = 0.02            # 1  | of a joule that the heater takes: smaller surplus goes to the brake
MOVED_K = 2.0                   # K  | so close an arrival is made exact by the last interval
SPARE_SOC = 1e-7                # 1  | charge above the reserve at which plans aim
PRICED_SOC = 5e-4               # 1  | by which charge is moved for its price
PRICED_K = 0.3                  # K  | by which heat under way is moved
WATCHED_BELOW_K = 1.0           # K  | a limit may act in a step if it does for a colder battery
WATCHED_SOC = 0.02              # 1  | … or for this more or less charge
SOC_DIFFERENCE = 1e-4           # 1  | for slopes of the model's rates
TEMPERATURE_DIFFERENCE_K = 0.1  # K  | for slopes of the model's rates
LEAST_SAVING_WH = 0.05          # Wh | for less, heating elsewhere is not worth another search
NEAR_K = 0.2                    # K  | the first part of a missing kelvin under an Uncertainty
NEAR_PRICE = 2.0                # 1  | … in its energies: no heater is switched on again for so little
LACK_PRICE = 2000.0             # 1  | cost of a joule that the battery cannot deliver, in joules
EMPTY_J = 1e12                  # J  | cost of a step that empties the battery
FIRST_STEP_K = 0.5              # K  | between temperatures of the first pass
BELOW_K = 3.0                   # K  | … from this below the coldest unheated temperature
ABOVE_K = 25.0                  # K  | … to this above target and start
WIDE_STEP_K = 0.1               # K  | between temperatures of the second pass
WIDE_K = 1.5                    # K  | … around the path before
NARROW_STEP_K = 0.01            # K  | of the third pass
NARROW_K = 0.15                 # K  | … around the path before
LAST_STEP_K = 0.001             # K  | of the last pass
LAST_K = 0.015                  # K  | … around the path before
EXPECTED_PASSES = 3             # n  | under an Uncertainty
WIDER_DEVIATIONS = 2.5          # sd | by which those passes are wider: nearly all of the weight
TABLE_STEP_K = 0.03             # K  | between temperatures of a ValueTable
STRETCH_K = 6.0                 # K  | driven from three temperatures, with a parabola through their ends
STRETCH_J = 10.0                # J  | … if a fourth one is as near to it as this
MOST_LOOKS = 7                  # n  | passes made at most, repeated ones included
NEAR_RESERVE_K = 0.1            # K  | the first pass is made again while the aim moves by more
EDGE_SHARE = 0.9                # 1  | of a pass's width: a path that reaches it makes another
LOOK_WH = 0.25                  # Wh | … that saves more than this
NO_WORSE_W = 10.0               # W  | deficits of power that differ by less are alike

# planning/steps_ahead.py, limited_drive.py, limits.py, bracketing.py …: rounding and ends of searches
ARRIVAL_TOLERANCE_K = 5e-6       # K    | of a run that meets the target: 1 mWh for a large pack
MOST_TRIALS = 60                 # n    | a secant needs two to four; a search ends in any case
HALVINGS = 50                    # n    | of a bracket: to the last digit
END_TOLERANCE_W = 1e-3           # W    | of the limit at the end of a step
HIGHEST_TOLERANCE_K = 1e-6       # K    | of the highest temperature
MOST_REPEATS = 6                 # n    | of a run whose steps of power change its gates
HEATED_W = 1e-3                  # W    | less is rounding
ROUNDING_W = 1.0                 # W    | powers of the heater that differ by less are the same
POWER_TOLERANCE = 1e-6           # 1    | share of a power: a smaller deficit is rounding
HEATING_ALLOWANCE = 1.1          # 1    | leakage takes a tenth of the heat on the way
LOST_ABOVE_TARGET_K = 100.0      # K    | no forward run meets a backward one so far above the target
LEAST_HEATING_W = 50.0           # W    | less is no heating
LEAST_SOURCE_W = 10.0            # W    | less heat of a source beside another is rounding
MOST_PHASES = 4                  # 1    | changes of heat sources that a sentence tells one by one
LACK_TOLERANCE_W = 0.2           # W    | beyond a limit: no deficit
COMPARED_TOLERANCE_K = 2e-4      # K    | of an arrival while switch-off instants are compared
SURE_SHARE = 0.5                 # 1    | of the heat from the start that is certain on arrival
MOST_LAGS = 7.0                  # n    | within which all heat but a thousandth arrives: e^-7
OFF_RESOLUTION_S = 2.0           # s    | around the best instant the energy hardly changes
DEFICIT_WH_PER_K = 1e9           # Wh/K | a missing kelvin counts more than any energy
LATEST_START_TOLERANCE_K = 1e-4  # K    | of the arrival
START_RESOLUTION_S = 1e-2        # s    | of the start of heating
ABOVE_TARGET_K = 0.05            # K    | an arrival above is heated for the drive, or for free
MOST_CHANGED_K = 0.01            # K    | a later start that changes the arrival by more is not used
TAIL = 8.0                       # sd   | beyond it closed forms lose precision
