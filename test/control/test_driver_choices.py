# SPDX-License-Identifier: Apache-2.0
"""The driver's opt-out, a cancelled trip and the battery's last state, over a restart of the planner."""

import pytest
from steady_drives import measured, NOW_NS, steady_mission, VEHICLE
from stepwise import Stepwise

from bev_preheat.control.inputs import Measurement
from bev_preheat.control.settings import Settings
from bev_preheat.estimation.before_restart import CancelledTrip, DriverChoices, LastSeen, NO_CHOICES
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status

HOUR_NS = 3600 * NS_PER_S
SETTINGS = Settings(minimum_on_time_s=0.0, minimum_off_time_s=0.0)


def start(choices=NO_CHOICES, now_ns=NOW_NS, mission=None):
    """Return a Stepwise planner that was restarted with these choices, a route and a cold battery."""
    planner = Stepwise(VEHICLE, SETTINGS, choices=choices.after_restart(now_ns))
    planner.refresh(now_ns)
    planner.accept_mission(mission or steady_mission())
    planner.accept_battery(measured(now_ns), now_ns)
    return planner


def answer(planner):
    command = planner.state.latest_command
    return command.battery_heating_power_w > 0.0, command.reason


HEATS, OFF, CANCELLED = ((True, Status.TARGET_UNREACHABLE), (False, Status.DISABLED),
                         (False, Status.NO_CHARGING_PLANNED))


def test_an_opt_out_survives_a_restart_until_the_driver_takes_it_back():
    planner = start()
    planner.enabled = False
    assert planner.state.inbox.choices == DriverChoices(NOW_NS)
    again = start(planner.state.inbox.choices)
    assert answer(again) == OFF
    again.enabled = True
    assert (answer(again), again.state.inbox.choices) == (HEATS, NO_CHOICES)


@pytest.mark.parametrize('age_ns, is_off', [
    (24 * HOUR_NS, True), (24 * HOUR_NS + 1, False),
    # The clock was set back, so the age of the choice is unknown.
    (-5 * HOUR_NS, True)])
def test_an_opt_out_counts_for_a_day(age_ns, is_off):
    assert answer(start(DriverChoices(NOW_NS - age_ns))) == (OFF if is_off else HEATS)


def test_an_opt_out_does_not_end_while_the_process_lives():
    planner = start(DriverChoices(NOW_NS - 24 * HOUR_NS))
    assert planner.command(NOW_NS + HOUR_NS).reason is Status.DISABLED


# A trip: its publisher latches the route, another node has cancelled it

def cancelled_choices():
    planner = start()
    planner.cancel()
    return planner.state.inbox.choices


def test_the_route_of_a_cancelled_trip_does_not_heat_after_a_restart():
    planner = start(cancelled_choices(), NOW_NS + 60 * NS_PER_S)
    assert (answer(planner), planner.state.mission) == (CANCELLED, None)
    assert planner.state.decision.explanation == (
        'The trip was cancelled before the planner restarted: no heating until a route plan with '
        'another stamp arrives.')
    # It is also remembered for the next restart.
    assert planner.state.inbox.choices == cancelled_choices()


@pytest.mark.parametrize('mission', [
    steady_mission('work'), steady_mission(start_ns=NOW_NS + NS_PER_S)], ids=['another', 'sent again'])
def test_any_other_route_heats_after_a_restart(mission):
    now_ns = NOW_NS + 60 * NS_PER_S
    planner = start(cancelled_choices(), now_ns, mission)
    assert (answer(planner), planner.state.inbox.choices) == (HEATS, NO_CHOICES)
    # Then the first route may be driven after all.
    planner.accept_mission(steady_mission())
    assert answer(planner) == HEATS


def test_a_cancellation_counts_for_a_day():
    now_ns = NOW_NS + 24 * HOUR_NS
    choices = DriverChoices(None, CancelledTrip('home', NOW_NS, NOW_NS))
    assert answer(start(choices, now_ns)) == CANCELLED
    assert choices.after_restart(now_ns + 1) == NO_CHOICES


def test_a_second_cancellation_says_nothing_of_another_trip():
    planner = start()
    planner.cancel()
    planner.cancel()
    assert planner.state.inbox.choices == cancelled_choices()


SEEN = LastSeen(11.0, 0.5, NOW_NS - 9 * HOUR_NS)


@pytest.mark.parametrize('estimation', [False, True])
def test_last_seen_is_that_from_before_the_restart_until_the_battery_tells(estimation):
    planner = Stepwise(VEHICLE, Settings(estimation=estimation), last_seen=SEEN)
    planner.refresh(NOW_NS)
    assert planner.state.last_seen == SEEN
    planner.accept_battery(Measurement(BatteryState(-7.0, 0.75), NOW_NS), NOW_NS)
    seen = planner.state.last_seen
    assert (seen.temperature_c, seen.soc, seen.stamp_ns) == (
        pytest.approx(-7.0, abs=0.01), pytest.approx(0.75, abs=1e-4), NOW_NS)
