# SPDX-License-Identifier: Apache-2.0
"""A temperature reading that does not follow the battery."""

import pytest

from bev_preheat.estimation.temperature_check import StuckTemperature


def feed(readings_c, rate_k_per_s, ambient_c=-7.0):
    """Return (instant of the doubt [s], the doubt at the end) of readings every 5 s by a sensor of 1 K."""
    watch, named_s = StuckTemperature(), None
    for number, reading_c in enumerate(readings_c):
        watch = watch.seen(50.0 + 5.0 * number, reading_c, 1.0, rate_k_per_s, ambient_c)
        if watch.doubt and named_s is None:
            named_s = 5.0 * number
    return named_s, watch.doubt


def test_a_reading_that_stays_while_the_battery_must_warm_is_named():
    # 3 K, and a step of the sensor of 1 K, at 0.8 K a minute: 5 min.
    named_s, doubt = feed([0.0] * 100, 0.8 / 60.0)
    assert named_s == pytest.approx(300.0, abs=10.0)
    assert doubt.startswith(
        'temperature: has read 0.00 degC since the first state, while the battery must have warmed')


@pytest.mark.parametrize('lag_s', [0.0, 60.0, 120.0])
@pytest.mark.parametrize('rate_k_per_min', [0.4, 0.9, 1.5])
def test_a_sensor_in_whole_degrees_that_lags_is_believed(lag_s, rate_k_per_min):
    true_c, shown_c, readings_c, rate = 0.0, 0.0, [], rate_k_per_min / 60.0
    for _ in range(400):
        true_c += 5.0 * rate
        # A first-order lag of the reading, and the same lag of the heat.
        if true_c > rate * lag_s:
            shown_c += (true_c - rate * lag_s - shown_c) * min(1.0, 5.0 / max(lag_s, 5.0))
        readings_c.append(float(round(shown_c)))
    assert feed(readings_c, rate)[0] is None


def test_a_battery_near_its_balance_may_stay_as_warm_for_an_hour():
    assert feed([20.0] * 720, 0.2 / 60.0)[0] is None


def test_a_moving_reading_ends_the_doubt():
    assert feed([0.0] * 100 + [1.0], 0.8 / 60.0)[1] == ''


def test_far_below_ambient_is_no_battery():
    named_s, doubt = feed([-40.0], 0.0)
    assert named_s == 0.0
    assert '-40.0 degC is 33.0 K below the ambient temperature of -7.0 degC' in doubt
    assert feed([-20.0] * 3, 0.0)[1] == ''
    assert feed([-40.0] * 3, 0.0, ambient_c=None)[1] == ''


def test_a_battery_from_a_cool_garage_is_believed_on_a_hot_day():
    assert feed([15.0, 15.0, 16.0], 0.0, ambient_c=38.0)[1] == ''
    # Unset fields read 0 or -40.
    assert all('garage; the field may not be set' in feed([unset_c], 0.0, ambient_c=38.0)[1]
               for unset_c in (0.0, -40.0))


def test_a_first_reading_far_below_ambient_is_doubted_until_it_moves_even_if_the_ambient_is_no_longer_known():
    first = StuckTemperature().seen(0.0, -40.0, 0.5, 0.0, 0.0)
    assert '40.0 K below the ambient' in first.doubt
    # Without heat that proves it, still the same reading.
    again = first.seen(1.0, -40.0, 0.5, 0.0, None)
    assert again.doubt == first.doubt
    assert again.seen(2.0, -1.0, 0.5, 0.0, 0.0).doubt == ''
