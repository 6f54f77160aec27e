# SPDX-License-Identifier: Apache-2.0
"""
A whole car without a message of ROS written by hand: CAN, bus_gateway, planner, heater, CAN.

The car plays itself in real time, on adapters at pseudo terminals; its battery is small, so that a drive takes a
minute. Executables are the installed ones; the route is a file that route_publisher publishes.

Daily, test_bus_gateway.py has CAN, its leases and a heater that refuses over DDS, test_heater_controller.py a
commander that hangs; it also kills planner and heater in process.

Requests of the cabin come over VSS; daily, test_bus_conditioning.py has requests, goals and answers, also of a
planner that was lost.
"""

from itertools import groupby, permutations
import signal
import time

from can_car import CanCar, HEATER_TIMEOUT_S
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from example_frames import can_map, COMMAND
from node_bench import repeating
from planner_car import has_entry
import pytest
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64
from waiting import poll_until, TIME_LIMIT_S
import yaml

from bev_preheat.files.input_files import find_configuration
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan

pytestmark = [pytest.mark.needs('cantools', 'can', 'crccheck', 'serial'), pytest.mark.deep]
TARGET_C, AMBIENT_C, LOAD_W = 20.0, -7.0, 12e3
# The planner's parameters in these tests; no command holds longer than its lease, nor than its battery state. The
# bus's readings hold for 2 s: with such a timeout the planner would refuse the last state as too old.
LEASE_S, STATE_TIMEOUT_S = 1.5, 3.0
# Timers and a computer at work.
LATE_S = 0.5
PLANNER = ('-p', f'command_lease:={LEASE_S}', '-p', f'battery_state_timeout:={STATE_TIMEOUT_S}', '-p',
           'command_period:=0.3', '-p', 'minimum_on_time:=0.0', '-p', 'minimum_off_time:=0.0')


def small_battery(folder, heat_capacity_j_per_k):
    """Return a vehicle file of the CanCar."""
    vehicle = yaml.safe_load(find_configuration('vehicles', 'reference', '.yaml').read_text())
    vehicle['battery'].update(heat_capacity_j_per_k=heat_capacity_j_per_k, resistance={'table': {
        'temperature_c': [-40, 60], 'soc': [0, 1], 'values': [[0.1, 0.1], [0.1, 0.1]]}},
        leakage={'gamma_0_w_per_k': 20, 'gamma_v_w_per_k_per_mps': 0})
    vehicle['drivetrain']['heat_recovery_efficiency'] = 0.0
    path = folder / 'small_battery.yaml'
    path.write_text(yaml.safe_dump(vehicle))
    return path


class Drive:
    """The car, its files and its processes."""

    def __init__(self, start, folder, temperature_c, seconds, separate=True, heat_capacity_j_per_k=25e3,
                 heat_lag_s=0.0, options=()):
        """`separate`: heater_controller writes the command; else bus_gateway itself."""
        self._start, self.folder, self.separate, self._options = start, folder, separate, options
        self.car = CanCar(temperature_c, heat_capacity_j_per_k, AMBIENT_C, LOAD_W, heat_lag_s,
                          2 if separate else 1)
        self.vehicle = small_battery(folder, heat_capacity_j_per_k)
        self.route = folder / 'to_the_charger.csv'
        rows = [f'10.0,20.0,{LOAD_W},{AMBIENT_C},0.0,0.0' for _ in range(seconds // 10)]
        self.route.write_text('duration_s,speed_mps,propulsion_power_w,ambient_temperature_c,'
                              'cabin_heating_power_w,auxiliary_power_w\n' + '\n'.join(rows) + '\n')
        self.processes, self.has_lost_a_part = {}, False

    def parts(self):
        return ('bus_gateway', 'planner', *(['heater_controller'] if self.separate else []))

    def start(self, part):
        arguments = {
            'bus_gateway': ('-p', f'signals:={can_map(self.folder, self.car.ports[0].path)}', '-p',
                            'battery_state_period:=0.2', '-p',
                            f'execute_commands:={str(not self.separate).lower()}'),
            'planner': ('-p', f'vehicle:={self.vehicle}', *PLANNER, *self._options),
            'heater_controller': ('-p', f'vehicle:={self.vehicle}', '-p',
                                  f'signals:={can_map(self.folder, self.car.ports[-1].path)}', '-p',
                                  f'command_deadline:={LEASE_S}'),
            'route_publisher': ('-p', f'vehicle:={self.vehicle}', '-p', f'route:={self.route}', '-p',
                                f'target_battery_temperature:={TARGET_C}')}[part]
        self.processes[part] = self._start(part, *arguments)

    def kill(self, part):
        """Kill a process; return the instant [s, time.monotonic]."""
        self.has_lost_a_part = True
        self.processes[part].send_signal(signal.SIGKILL)
        self.processes[part].wait()
        return time.monotonic()

    def is_heated(self):
        return self.car.power_w > 0.0

    def kill_and_restart(self, part):
        """Kill a process while it heats, see that the heater is off within the lease, and restart it."""
        poll_until(self.is_heated, f'heat before {part} is killed')
        killed_s = self.kill(part)
        # Without states the planner commands until the latest one is too old.
        limit_s = {'bus_gateway': STATE_TIMEOUT_S if self.separate else 0.0, 'planner': LEASE_S,
                   'heater_controller': 0.0}[part] + HEATER_TIMEOUT_S + LATE_S
        time.sleep(limit_s + 1.0)
        powers = self.car.powers_since(killed_s + limit_s)
        assert powers and not any(power_w for _, power_w in powers), (part, powers)
        self.start(part)


@pytest.fixture(scope='module')
def driving(module_bench, tmp_path_factory):
    """`driving(…)` returns a Drive whose route has begun: that of the test before, if it is the same and whole."""
    under_way = {}
    states = module_bench.record(BatteryState, 'battery_state')
    commands = module_bench.record(HvchCommand, 'hvch_command')

    def end():
        for drive in under_way.values():
            for process in drive.processes.values():
                process.end()
            drive.car.close()
        under_way.clear()

    def driving(**named):
        if repr(named) in under_way and not under_way[repr(named)].has_lost_a_part:
            return under_way[repr(named)]
        end()
        states.clear()
        commands.clear()
        drive = Drive(module_bench.start, tmp_path_factory.mktemp('drive'), **named)
        under_way[repr(named)] = drive
        drive.car.rests = True
        for part in drive.parts():
            drive.start(part)
        states.wait_for(what='a battery')
        commands.wait_for(what='a command')
        poll_until(lambda: any(identifier == COMMAND for _, identifier, _ in drive.car.ports[-1].frames),
                   'frames of the heater')
        drive.start('route_publisher')
        commands.wait_for(lambda command: command.reason != Status.NO_ROUTE, 'the route')
        drive.car.rests = False
        return drive

    yield driving
    end()


# A battery of 25 kJ/K within 20 s, too short for the estimation of the car; and with all defaults one of
# 150 kJ/K within 8 min, whose heat arrives late.
SHORT = {'temperature_c': 17.5, 'seconds': 20, 'options': ('-p', 'estimation:=false')}
LONG = {'temperature_c': 8.0, 'seconds': 480, 'heat_capacity_j_per_k': 150e3, 'heat_lag_s': 15.0}


@pytest.mark.parametrize('separate, drive', [
    (True, SHORT), (False, SHORT), (True, LONG), (False, LONG)],
    ids=['heater_controller', 'gateway alone', 'heater_controller, 8 min', 'gateway alone, 8 min'])
def test_drive_arrives_with_a_warm_battery(driving, module_bench, separate, drive):
    driven = driving(**drive, separate=separate)
    # After it, so that no plan is of the drive before.
    plans = module_bench.record(PreheatPlan, 'preheat_plan', 100)
    plans.wait_for(lambda plan: plan.status == Status.ARRIVED, timeout_s=drive['seconds'] + TIME_LIMIT_S)
    assert driven.car.temperature_c == pytest.approx(TARGET_C, abs=0.5)
    assert driven.car.bad_frames == 0


# The battery is so large that it is heated throughout.
LARGE = {'temperature_c': -7.0, 'seconds': 1200, 'heat_capacity_j_per_k': 377e3}


ORDERS = [*permutations(['heater_controller', 'planner', 'bus_gateway']), ('planner', 'bus_gateway'),
          ('bus_gateway', 'planner')]


@pytest.mark.parametrize('order', ORDERS, ids=' '.join)
def test_each_process_that_is_killed_ends_the_heat_within_its_lease(driving, order):
    drive = driving(**LARGE, separate='heater_controller' in order)
    for part in order:
        drive.kill_and_restart(part)
    poll_until(drive.is_heated, 'heat after all restarts')


def test_wrong_frames_of_the_battery_end_in_0_w_and_are_named(driving, module_bench):
    """test/bus/test_can_live.py has the other attacks."""
    drive = driving(**LARGE)
    diagnostics = module_bench.record(DiagnosticArray, '/diagnostics', 100)
    poll_until(drive.is_heated, 'heat')
    drive.car.is_attacked, attacked_s = True, time.monotonic()
    for name, text in (('bus_gateway: signals', 'but the checksum of the data is 0x'),
                       ('planner: preheating', 'STALE_INPUT')):
        diagnostics.wait_for(has_entry(name, text, DiagnosticStatus.ERROR))
    # Readings hold for 2 s, and the planner waits for its timeout.
    limit_s = attacked_s + 2.0 + STATE_TIMEOUT_S + HEATER_TIMEOUT_S + LATE_S
    poll_until(lambda: time.monotonic() > limit_s + 1.0, 'a second of 0 W')
    assert not any(power_w for _, power_w in drive.car.powers_since(limit_s))
    drive.car.is_attacked = False
    poll_until(drive.is_heated, 'heat after the attack')


# Requests of the cabin

PACK = 'Vehicle.Powertrain.TractionBattery'
CONDITIONING = f'{PACK}.BatteryConditioning'
MODE, IS_ACTIVE, IS_ONGOING = (f'{CONDITIONING}.{name}' for name in ('RequestedMode', 'IsActive', 'IsOngoing'))
AMBIENT = 'Vehicle.Exterior.AirTemperature'


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
    car = CanCar(18.5, 25e3, AMBIENT_C, 300.0, 0.0, 1)
    cabin = Cabin(car)
    with repeating(cabin.update, 0.1):
        yield cabin
    cabin.broker.close()
    car.close()


@pytest.mark.needs('kuksa_client')
def test_request_ends_in_a_warm_battery_and_is_reported_back(cabin, bench, tmp_path):
    car, broker = cabin.car, cabin.broker
    vehicle = small_battery(tmp_path, 25e3)
    signals = tmp_path / 'car_vss.yaml'
    shipped = find_configuration('signals', 'vss', '.yaml').read_text()
    signals.write_text(shipped.replace('port: 55555', f'port: {broker.port}'))
    bench.start('bus_gateway', '-p', f'signals:={signals}', '-p', 'battery_state_period:=0.2')
    bench.start('planner', '-p', f'vehicle:={vehicle}', *PLANNER, '-p', 'estimation:=false')
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
