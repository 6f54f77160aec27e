# SPDX-License-Identifier: Apache-2.0
"""The expected drive between two instants, from the route."""

import pytest
from steady_drives import at, VEHICLE

from bev_preheat.control.expected_drive import intervals_between
from bev_preheat.control.heater import SourcePowers
from bev_preheat.control.inputs import Leg, Mission, Progress
from bev_preheat.control.settings import Settings
from bev_preheat.control.timetable import Timetable
from bev_preheat.route.segments import make_route


def leg(start_s, powers_w, rms_w=None, cabin_w=1500.0):
    return Leg(make_route({
        'duration_s': [60.0] * len(powers_w), 'speed_mps': [20.0 + number for number in range(len(powers_w))],
        'propulsion_power_w': powers_w, 'propulsion_power_rms_w': rms_w, 'ambient_temperature_c': [-7.0],
        'cabin_heating_power_w': [cabin_w], 'auxiliary_power_w': [400.0]}, None), at(start_s))


# A stop of 400 s lies between the two.
EXPECTED = Timetable.of(Mission('two legs', (
    leg(0.0, [10e3, 20e3, -5e3], rms_w=[10e3, 25e3, 13e3]),
    leg(580.0, [7e3], cabin_w=9000.0))))


def between(from_s, to_s, timetable=EXPECTED):
    """Return (DriveInputs, heater power left by the cabin [W]) of the single step between two instants."""
    interval, = intervals_between([at(from_s), at(to_s)], VEHICLE, timetable, SourcePowers())
    return interval.drive, interval.limit_w


@pytest.mark.parametrize('from_s, to_s, power_w', [
    (0.0, 1.0, 10e3), (58.0, 59.9, 10e3), (59.0, 62.0, 20e3), (120.0, 179.0, -5e3), (590.0, 591.0, 7e3),
    # With the middle exactly at the start of the trip, of a segment and of the second leg.
    (-1.0, 1.0, 10e3), (55.0, 65.0, 20e3), (579.0, 581.0, 7e3),
    # Within a nanosecond of the end.
    (178.0, 181.999_999_998, -5e3)])
def test_the_segment_of_the_middle_is_what_is_driven(from_s, to_s, power_w):
    assert between(from_s, to_s)[0].propulsion_power_w == power_w


@pytest.mark.parametrize('from_s, to_s, timetable', [
    (-10.0, -8.0, EXPECTED), (-3.0, 1.0, EXPECTED), (181.0, 182.0, EXPECTED), (300.0, 500.0, EXPECTED),
    (700.0, 701.0, EXPECTED), (179.0, 181.0, EXPECTED), (639.0, 641.0, EXPECTED), (0.0, 1.0, None)],
    ids=['before', 'begins', 'stop', 'at the stop', 'after', 'end of the leg', 'end of the trip', 'no route'])
def test_beyond_the_route_and_without_one_nothing_is_known(from_s, to_s, timetable):
    assert between(from_s, to_s, timetable) == (None, 0.0)


def test_who_is_half_as_fast_takes_half_the_power():
    """The same energy per metre; cabin and auxiliaries keep their power."""
    timetable = EXPECTED
    for at_s, distance_m in (100.0, 1300.0), (102.0, 1321.0), (104.0, 1342.0):
        timetable = timetable.at_progress(Progress(distance_m, at(at_s), 'two legs'), at(at_s), Settings())
    drive, _ = between(102.0, 104.0, timetable)
    planned, _ = between(65.0, 66.0)
    for field, share in (('speed_mps', 0.5), ('propulsion_power_w', 0.5),
                         ('power_variance_w2', 0.25), ('propulsion_power_magnitude_w', 0.5),
                         ('cabin_heating_power_w', 1.0), ('auxiliary_power_w', 1.0),
                         ('ambient_temperature_c', 1.0)):
        assert getattr(drive, field) == pytest.approx(share * getattr(planned, field)), field
