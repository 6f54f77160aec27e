# SPDX-License-Identifier: Apache-2.0
"""VSS data of a broker over gRPC, by both versions of the protocol: values on change, and a broker that goes."""

import time

import pytest
from waiting import poll_until

from bev_preheat.bus.conditioning import ACTUATORS, IS_ACTIVE, MODE
from bev_preheat.bus.live_map import load_live_map
from bev_preheat.bus.source import steady_s
from bev_preheat.bus.vss_source import VssSource

pytestmark = [pytest.mark.needs('kuksa_client')]
PACK = 'Vehicle.Powertrain.TractionBattery'
CONDITIONING = f'{PACK}.BatteryConditioning'


def new_broker(**options):
    # The broker needs grpc, which is optional.
    from vss_broker import Broker
    return Broker(**options)


def set_all(broker, temperature_c=-6.5):
    for name, value in (('Temperature.Average', temperature_c), ('Temperature.Min', temperature_c - 2.0),
                        ('Temperature.Max', temperature_c + 1.0), ('StateOfCharge.Current', 62.5),
                        ('CurrentVoltage', 350.0), ('CurrentCurrent', -80.0), ('Charging.IsCharging', False)):
        broker.set(f'{PACK}.{name}', value)


class Cabin:
    """A broker and the source that listens to it; `ahead_s` moves the source's clock."""

    def __init__(self, folder, v2):
        self.v2, self.ahead_s, self.requests = v2, 0.0, []
        self.broker = new_broker(v2=v2)
        file = folder / 'vss.yaml'
        file.write_text(f"""name: vss_test
signals:
  battery_temperature_c: {{channels: {PACK}.Temperature.Average, unit: degC}}
  soc: {{channels: {PACK}.StateOfCharge.Current, unit: percent}}
  voltage_v: {{channels: {PACK}.CurrentVoltage, unit: V}}
  current_a: {{channels: {PACK}.CurrentCurrent, unit: A, positive: charging}}
live:
  vss: {{host: 127.0.0.1, port: {self.broker.port}}}
  cells_c: '/TractionBattery[.]Temperature[.](Min|Max)$/'
  charging: {{channel: {PACK}.Charging.IsCharging, values: [1]}}
""")
        self.source = VssSource(load_live_map(file), lambda: steady_s() + self.ahead_s, self.requests.append,
                                ACTUATORS)

    def battery(self):
        return self.source.battery(steady_s() + self.ahead_s)

    def has(self, temperature_c):
        battery = self.battery()[0]
        return battery if battery is not None and battery.temperature_c == temperature_c else None


@pytest.fixture(params=[True, False], ids=['v2', 'v1'])
def cabin(request, tmp_path):
    cabin = Cabin(tmp_path, request.param)
    cabin.source.start()
    yield cabin
    cabin.source.close()
    cabin.broker.close()


def test_values_arrive_with_unit_and_sign_and_hold_until_they_change(cabin):
    set_all(cabin.broker)
    battery = poll_until(lambda: (now := cabin.has(-6.5)) and len(now.cells_c) == 2 and None not in (
        now.soc, now.voltage_v, now.current_a, now.is_charging) and now, 'all values')
    assert battery.is_charging is False
    assert (battery.soc, battery.voltage_v) == pytest.approx((0.625, 350.0))
    # VSS counts the current into the battery; here a positive one discharges it.
    assert battery.current_a == pytest.approx(80.0)
    assert battery.cells_c == pytest.approx((-8.5, -5.5))
    updates = cabin.source.figures()['updates']
    time.sleep(1.2)
    # Nothing has changed and nothing was sent; the broker's signs of life confirm the values.
    now_s = steady_s()
    battery = cabin.battery()[0]
    assert cabin.source.figures()['updates'] == updates
    assert now_s - battery.instant_s < 1.1
    cabin.broker.set(f'{PACK}.Temperature.Average', -6.0)
    poll_until(lambda: cabin.has(-6.0), 'the changed value')


def test_a_value_that_is_withdrawn_or_implausible_holds_no_longer(cabin):
    for bad in (None, float('nan'), 900.0):
        set_all(cabin.broker)
        poll_until(lambda: cabin.has(-6.5), 'the battery')
        cabin.broker.set(f'{PACK}.Temperature.Average', bad)
        poll_until(lambda: cabin.battery()[0] is None, f'no battery after {bad}')
        assert f'{PACK}.Temperature.Average' in ' '.join(cabin.battery()[1])


def test_a_broker_that_is_gone_takes_the_battery_along_and_comes_back(cabin):
    set_all(cabin.broker)
    poll_until(lambda: cabin.has(-6.5), 'the battery')
    port = cabin.broker.port
    cabin.broker.close()
    poll_until(lambda: cabin.source.problem, 'the broker is missed')
    cabin.ahead_s = 4.0
    battery, (sentence,) = cabin.battery()
    assert battery is None and sentence.startswith('no sign of life of the connection for ')
    cabin.ahead_s = 0.0
    cabin.broker = new_broker(v2=cabin.v2, port=port)
    set_all(cabin.broker, -3.0)
    poll_until(lambda: cabin.has(-3.0), 'the new broker')
    assert cabin.source.problem == '' and cabin.source.connections == 2


def test_requests_of_the_cabin_arrive_and_the_state_goes_back(cabin):
    poll_until(cabin.broker.has_provider, 'the actuators are served')
    cabin.broker.request({MODE: 'FAST_CHARGING_PREPARATION', f'{CONDITIONING}.TargetTemperature': 25.0})
    poll_until(lambda: cabin.requests, 'the request')
    assert cabin.requests[0] == {MODE: 'FAST_CHARGING_PREPARATION', f'{CONDITIONING}.TargetTemperature': 25.0}
    cabin.source.publish({IS_ACTIVE: True, 'Vehicle.No.Such.Path': 1})
    cabin.broker.wait_for(IS_ACTIVE, True)
