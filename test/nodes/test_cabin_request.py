# SPDX-License-Identifier: Apache-2.0
"""A request of the cabin over VSS ends in a warm battery, and is reported back."""

from itertools import groupby

from can_car import CanCar
from example_frames import can_map, COMMAND
from node_bench import repeating
import pytest
from std_msgs.msg import Float64
from test_whole_car import small_battery
from waiting import poll_until

from bev_preheat.files.input_files import find_configuration

pytestmark = [pytest.mark.needs('kuksa_client', 'cantools', 'can', 'crccheck', 'serial')]
PACK = 'Vehicle.Powertrain.TractionBattery'
CONDITIONING = f'{PACK}.BatteryConditioning'
MODE, IS_ACTIVE, IS_ONGOING = (f'{CONDITIONING}.{name}' for name in ('RequestedMode', 'IsActive', 'IsOngoing'))
AMBIENT = 'Vehicle.Exterior.AirTemperature'
AMBIENT_C, START_C, TARGET_C = -7.0, 18.5, 20.0


class Cabin:
    """A broker with the values of a CanCar."""

    def __init__(self, car):
        # The broker needs grpc, which is optional.
        from vss_broker import Broker
        self.broker, self.car, self._known = Broker(), car, {}

    def update(self):
        """Set the values that have changed, as the car's sensors resolve them."""
        car = self.car
        for path, value in ((f'{PACK}.Temperature.Average', round(car.temperature_c, 1)),
                            (f'{PACK}.StateOfCharge.Current', round(100.0 * car.soc, 1)),
                            (f'{PACK}.CurrentVoltage', 400.0),
                            (f'{PACK}.CurrentCurrent', round(-(300.0 + car.power_w) / 400.0, 1)),
                            (f'{PACK}.Charging.IsCharging', False), (AMBIENT, AMBIENT_C), ('Vehicle.Speed', 36.0)):
            if self._known.get(path) != value:
                self._known[path] = value
                self.broker.set(path, value)

    def values(self, path):
        """Return the values of a path that were published, in order, without repetitions."""
        return [value for value, _ in groupby(value for at, value in self.broker.history if at == path)]


@pytest.fixture
def cabin():
    car = CanCar(START_C, 25e3, AMBIENT_C, 300.0, 0.0, 1)
    cabin = Cabin(car)
    with repeating(cabin.update, 0.1):
        yield cabin
    cabin.broker.close()
    car.close()


# The requests, goals and answers, also those of a planner that was lost: test_bus_conditioning.py, daily.
@pytest.mark.deep
def test_request_ends_in_a_warm_battery_and_is_reported_back(cabin, bench, tmp_path):
    car, broker = cabin.car, cabin.broker
    vehicle = small_battery(tmp_path, 25e3)
    signals = tmp_path / 'car_vss.yaml'
    shipped = find_configuration('signals', 'vss', '.yaml').read_text()
    signals.write_text(shipped.replace('port: 55555', f'port: {broker.port}'))
    bench.start('bus_gateway', '-p', f'signals:={signals}', '-p', 'battery_state_period:=0.2')
    bench.start('planner', '-p', f'vehicle:={vehicle}', '-p', 'command_period:=0.3', '-p', 'estimation:=false',
                '-p', 'minimum_on_time:=0.0', '-p', 'minimum_off_time:=0.0')
    bench.start('heater_controller', '-p', f'vehicle:={vehicle}', '-p',
                f'signals:={can_map(tmp_path, car.ports[0].path)}')
    speeds = bench.record(Float64, 'vehicle_speed', 1)
    broker.wait_for(IS_ACTIVE, False)
    poll_until(broker.has_provider, 'the actuators are served')
    frames = car.ports[0].frames
    poll_until(lambda: any(identifier == COMMAND for _, identifier, _ in frames), 'frames of the heater')
    assert car.power_w == 0.0

    broker.request({MODE: 'FAST_CHARGING_PREPARATION', f'{CONDITIONING}.TargetTemperature': TARGET_C})
    broker.wait_for(MODE, 'FAST_CHARGING_PREPARATION')
    broker.wait_for(IS_ONGOING, True)
    assert broker.values[IS_ACTIVE] is True
    broker.wait_for(MODE, 'INACTIVE')
    broker.wait_for(IS_ONGOING, False)
    broker.wait_for(IS_ACTIVE, False)
    assert car.temperature_c == pytest.approx(TARGET_C, abs=0.5)
    # The heater may pause close to the target.
    assert cabin.values(IS_ONGOING)[:2] == [False, True]
    assert cabin.values(IS_ACTIVE) == [False, True, False]
    assert cabin.values(MODE) == ['INACTIVE', 'FAST_CHARGING_PREPARATION', 'INACTIVE']
    assert speeds.wait_for().data == pytest.approx(10.0)
    poll_until(lambda: car.power_w == 0.0, 'that the heater is off')
