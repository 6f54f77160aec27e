# SPDX-License-Identifier: Apache-2.0
"""All trips of a block computed at once arrive as one by one, even with an active limit."""

import numpy as np
import pytest

from bev_preheat.native.calls import ALWAYS_ON, ONE_SWITCH, PAPER, plan_trips, UNHEATED
from bev_preheat.native.library import core, Declined, LIMITED, OK
from bev_preheat.planning.core_engine import trip_in_core, vehicle_in_core
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import reserve_soc
from bev_preheat.planning.trip import make_trip
from bev_preheat_studies.fleet import arrivals as fleet_arrivals
from bev_preheat_studies.fleet.arrivals import arrivals_of_all
from bev_preheat_studies.fleet.drawing import draw_fleet
from bev_preheat_studies.fleet.drawn_fleet import CARS, goal_of, vehicle_of
from bev_preheat_studies.fleet.ways import Arrival, arrivals_of, WAYS

needs_core = pytest.mark.skipif(core() is None, reason='bev_preheat_core is not built')


@pytest.fixture(scope='module')
def trips():
    """40 drawn trips, of each car several."""
    return draw_fleet(6, 0, 40)


def planned(trips, car, places, target_c=None, lowest_soc=None, steps=None):
    vehicle, goal = vehicle_of(car), goal_of(car)
    trip = make_trip(vehicle, trips.route(places))
    count = places.stop - places.start
    return plan_trips(
        vehicle_in_core(vehicle), trip_in_core(trip), trips.steps[places] if steps is None else steps,
        trips.start_soc[places], trips.start_c[places],
        np.full(count, goal.target_temperature_c if target_c is None else target_c),
        reserve_soc(vehicle, goal), vehicle.battery.soc_range[0] if lowest_soc is None else lowest_soc)


@needs_core
def test_a_block_arrives_as_its_trips_do_one_by_one(trips):
    arrivals = arrivals_of_all(trips)
    for place in range(0, len(trips), 2):
        trip = trips.trip(place)
        expected = arrivals_of(trip, vehicle_of(trip.car))
        assert arrivals.are_driven[place] and list(expected) == list(WAYS)
        for values, name in ((arrivals.heater_wh, 'heater_wh'), (arrivals.temperature_c, 'temperature_c'),
                             (arrivals.soc, 'soc')):
            # To 1 mWh; the others much closer than required.
            assert values[place] == pytest.approx(
                [getattr(expected[way], name) for way in WAYS], abs=1e-3 if name == 'heater_wh' else 1e-9)


@needs_core
def test_the_instants_are_those_of_the_plans(trips):
    instants = 0
    for car, places in trips.cars():
        found = planned(trips, car, places)
        for row in range(0, len(found), 2):
            trip = trips.trip(places.start + row)
            for method, way in (('optimal_switch', ONE_SWITCH), ('value_function', ONE_SWITCH), ('paper', PAPER)):
                plan = plan_preheating(vehicle_of(car), trip.route, trip.state, trip.goal, method)
                if found['status'][row, way] != OK:
                    continue
                instant_s = found['instant_s'][row, way]
                if plan.heating_start_s is None:
                    assert np.isnan(instant_s)
                else:
                    instants += 1
                    assert instant_s == pytest.approx(plan.heating_start_s, abs=1e-3)
    assert instants > 20


def test_a_limited_trip_is_asked_for_one_by_one(trips, monkeypatch):
    asked = []

    def found(trips, car, places):
        table = np.zeros((places.stop - places.start, 4), [
            ('heater_wh', float), ('temperature_c', float), ('soc', float), ('instant_s', float), ('status', int)])
        table['status'][1, ONE_SWITCH] = table['status'][2, :] = LIMITED
        return table

    def one(trip, vehicle, methods):
        asked.append((trip.number, tuple(methods)))
        return None if len(asked) % 2 else {way: Arrival(1.0, 2.0, 3.0) for way in WAYS}

    monkeypatch.setattr(fleet_arrivals, 'planned_in_the_core', found)
    monkeypatch.setattr(fleet_arrivals, 'arrivals_of', one)
    arrivals = arrivals_of_all(trips)
    first = next(iter(trips.cars()))[1].start
    assert asked[:2] == [(trips.number[first + 1], ('optimal_switch', 'value_function')),
                         (trips.number[first + 2], ('paper', 'optimal_switch', 'value_function'))]
    assert arrivals.are_driven[first:first + 3].tolist() == [True, False, True]
    assert np.isnan(arrivals.soc[first + 1]).all() and (arrivals.soc[first + 2] == 3.0).all()
    assert (arrivals.soc[first] == 0.0).all()


@needs_core
def test_what_limits_a_trip_is_in_its_statuses(trips):
    car, places = next(trips.cars())
    assert (planned(trips, car, places)['status'] == OK).all()
    # The reserve exceeds the charge: it can drive unheated and heated throughout, but no plan is allowed.
    found = planned(trips, car, places, lowest_soc=0.99)['status']
    assert (found[:, [ONE_SWITCH, PAPER]] == LIMITED).all() and (found[:, [UNHEATED, ALWAYS_ON]] == OK).all()
    # A NaN target is an error of each trip, whose numbers must not be used.
    assert (planned(trips, car, places, target_c=np.nan)['status'] < OK).all()


@needs_core
@pytest.mark.parametrize('change', [lambda steps: steps - 1, lambda steps: steps + 1,
                                    lambda steps: np.where(np.arange(len(steps)) == 0, 0, steps)])
def test_steps_that_are_not_those_of_the_arrays_are_refused(trips, change):
    car, places = next(trips.cars())
    assert car == next(iter(CARS))
    with pytest.raises(Declined):
        planned(trips, car, places, steps=change(trips.steps[places]))
