# SPDX-License-Identifier: Apache-2.0
"""Knowledge of a day on which all sorts of things happen to a battery, its sensors and the clock."""

import random

from bev_preheat.control.decision import AdmittedInputs
from bev_preheat.control.heater_power import CommandHistory
from bev_preheat.control.inputs import Leg, Measurement, Mission, SupplyStatus
from bev_preheat.control.knowledge import Knowledge
from bev_preheat.control.regime import Regime
from bev_preheat.control.settings import Settings
from bev_preheat.control.timetable import Timetable
from bev_preheat.estimation.signal_checks import CURRENT, SOURCE, TEMPERATURE, VOLTAGE
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
START_NS = 1_700_000_000 * NS_PER_S
MISSION = Mission('day', (Leg(load_route('reference', VEHICLE.defaults), START_NS, True, 20.0),))
# What happens from these seconds on.
HAPPENS = {0: 'drive', 150: 'other voltage', 250: 'drive', 400: 'charging', 440: 'drive', 550: 'two batteries',
           620: 'drive', 700: 'silence', 760: 'standing', 900: 'drive', 1000: 'stuck', 1700: 'reversed'}
SECONDS, EXPIRED_S = 2000, 760


def measurements():
    """Yield (second, Measurement) of a day on which all sorts of things happen."""
    drawn, soc, temperature_c, wander_w, now = random.Random(3), 0.8, -5.0, 0.0, ''
    for second in range(SECONDS):
        now = HAPPENS.get(second, now)
        wander_w += -0.2 * wander_w + 4e3 * drawn.gauss(0.0, 1.0)
        power_w = {'charging': -11e3, 'standing': 900.0}.get(now, 18e3 + wander_w)
        current_a = power_w / 400.0
        soc -= current_a / VEHICLE.battery.capacity_as
        temperature_c += 0.0 if now == 'stuck' else 0.002
        shown_c = temperature_c if now == 'stuck' else round(temperature_c + 0.1 * drawn.gauss(0.0, 1.0), 1)
        voltage_v = 20.0 if now == 'other voltage' else 430.0 - 0.1 * current_a
        if now != 'silence':
            yield second, Measurement(
                BatteryState(shown_c, round(soc, 4)), START_NS + second * NS_PER_S, voltage_v,
                -current_a if now == 'reversed' else current_a, supply_status=SupplyStatus.UNKNOWN,
                serial_number=('front', 'rear')[second % 2] if now == 'two batteries' else '')


def stream():
    """Return all statements of a Knowledge after each state, and the Knowledge."""
    knowledge, timetable, commands = Knowledge(), Timetable.of(MISSION), CommandHistory().noted(START_NS, 5e3)
    said = []
    for second, measurement in measurements():
        if second == EXPIRED_S:
            knowledge = knowledge.state_expired()
        knowledge, known = knowledge.seen(measurement, AdmittedInputs(
            VEHICLE, Settings(), True, '', None, False, False, timetable, timetable, measurement), commands)
        timetable = known.timetable
        said.append((knowledge.regime, knowledge.verdicts))
    return said, knowledge


def test_all_that_happens_on_a_day_is_known_and_a_restarted_clock_leaves_the_sign_of_the_current_alone():
    said, knowledge = stream()
    assert {regime.regime for regime, _ in said} >= {Regime.DRIVING, Regime.CHARGING, Regime.STANDING}
    assert {verdict.signal for _, verdicts in said for verdict in verdicts} >= {
        CURRENT, SOURCE, TEMPERATURE, VOLTAGE}
    without = knowledge.without_instants()
    assert without.sign.sign is knowledge.sign.sign
    assert without.regime.regime is Regime.UNKNOWN
