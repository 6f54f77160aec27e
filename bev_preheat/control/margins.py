# SPDX-License-Identifier: Apache-2.0
"""
The margins and tolerances between a plan and the heater, each with its unit and its reason.

`settings.Settings` has those that an integrator sets (timeouts, lease, least times on and off),
`planning.planner` the tolerances of a plan, `estimation.belief` and `estimation.prior` the noise and spreads of
the estimation.
"""

from bev_preheat.planning.planner import SHORTFALL_TOLERANCE_K, SOC_TOLERANCE

# The tolerances of a plan, with which a preparation is concluded, too.
__all__ = ['SHORTFALL_TOLERANCE_K', 'SOC_TOLERANCE']

# Uncertainty

# A plan expects that the arrival's standard deviation, less that of the temperature now, becomes known on the
# way: at least and at most so much [K]. Heat that a longer lag than estimated would delay counts beside it, less
# and less during the first heating of this time [s], which reveals the lag: chosen on `preheat robustness`.
LEAST_REVEALED_K, MOST_REVEALED_K = 0.02, 3.0
LAG_REVEALED_S = 300.0

# Hysteresis and least times

# For its least time on, the heater heats no further above the target than the first number, and stops this far
# below the highest temperature of the battery's range [K].
HELD_ABOVE_TARGET_K = 1.0
HELD_BELOW_HIGHEST_K = 3.0
# A new status of a plan is shown once it has held for this time [s]: successive plans may lie on either side of
# a bound.
LEAST_STATUS_S = 10.0

# Doubt

# After heating was interrupted by doubt, this time without any must pass [s]; it doubles with each further
# interruption within COUNTED_OVER_S [s], up to minimum_off_time or LEAST_LONGEST_WAIT_S [s].
FIRST_WAIT_S = 10.0
COUNTED_OVER_S = 600.0
LEAST_LONGEST_WAIT_S = 120.0
# The heater is switched on at most this often within an hour [s], whatever the inputs.
MOST_SWITCH_ONS, HOUR_S = 20, 3600.0
# Once half of the switch-ons are used up, each switching lasts at least this long [s], so that the rest lasts
# for the hour.
SPACING_S = HOUR_S / MOST_SWITCH_ONS / 2.0
# A battery state overtaken by a later one by no more than this [s] is dropped silently: networks reorder.
MOST_OVERTAKEN_S = 1.0
# A battery state that was young enough on arrival holds for at least this time [s], or half of
# battery_state_timeout if that is less: twice the period of a usual feed. Coarse or late stamps would otherwise
# reach the limit just before the next state, and each time count as doubt.
LEAST_HELD_S = 2.0
# A clock that falls back by more than this [s] was set or restarted; earlier stamps are void.
CLOCK_RESTART_S = 1.0
# A cell that is colder than the battery by more than this [K] is a failed sensor.
MOST_COLDER_K = 20.0

# A vehicle that stands

# Heating ends after this time of standing where the route has no stop [s]; sooner once the consumers are off,
# because the vehicle is parked then.
MOST_STANDING_S = 900.0
MOST_PARKED_S = 180.0
# A trip that starts later than this [s] raises no alarm: the battery may be charged or heated until then.
FORESEEN_S = 1800.0

# A preparation goal

# Heating "as soon as possible" ends after this time [s].
LONGEST_SOONEST_S = 6 * 3600.0
# An obstacle that lasts this long [s] ends the goal.
OBSTACLE_ENDS_GOAL_S = 60.0
# "As soon as possible" is reached this close to the target [K].
SOONEST_WITHIN_K = 0.1
# The state of charge of a vehicle that is plugged in does not fall by more than this.
CHARGE_FALLS_BY = 0.02
