# SPDX-License-Identifier: Apache-2.0
"""`bus_gateway` between a car on a CAN adapter and DDS: the battery one way, the heater's command the other."""

from can_car import CanCar, VOLTAGE_V
from diagnostic_msgs.msg import DiagnosticArray
from example_frames import can_map
from node_bench import repeating
from planner_car import command_at, has_entry
import pytest
from sensor_msgs.msg import BatteryState
from waiting import poll_until

from bev_preheat_msgs.msg import HeatSourceCommand, HeatSourceStatus, HvchCommand

pytestmark = [pytest.mark.needs('cantools', 'can', 'crccheck', 'serial')]

LEASE_S, CURRENT_A = 1.5, 50.0
# GenMsgCycleTime of the heater's frame in example_car.dbc.
FRAME_PERIOD_S = 0.1


@pytest.fixture
def car():
    """Give a CanCar that rests; to be used before `bench`, whose processes must end first."""
    car = CanCar(-8.2, 150e3, -7.0, 0.0, 0.0, 1)
    car.rests, car.current_a = True, CURRENT_A
    yield car
    car.close()


# Bad commands and a second commander: test_heater_controller.py, whose node executes commands by the same code.
def test_a_car_on_can_is_heated_within_the_lease_unless_its_heater_refuses(car, bench, tmp_path):
    states = bench.record(BatteryState, 'battery_state')
    diagnostics = bench.record(DiagnosticArray, '/diagnostics')
    process = bench.start('bus_gateway', '-p', f'signals:={can_map(tmp_path, car.ports[0].path)}', '-p',
                          'battery_state_period:=0.1')
    # Frames of before the car rested may wait in its port.
    state = states.wait_for(lambda state: state.cell_temperature and state.current != 0.0)
    assert (state.temperature, state.percentage, state.voltage) == pytest.approx((-8.2, 0.8, VOLTAGE_V))
    # sensor_msgs: negative while it is discharged.
    assert state.current == pytest.approx(-CURRENT_A)
    assert list(state.cell_temperature) == pytest.approx([-9.7, -6.7])

    commands = bench.publisher(HvchCommand, 'hvch_command', 1)
    commands.wait_for_subscription()

    def commanding(power_w):
        return repeating(lambda: commands.publish(command_at(bench.now_ns, power_w, LEASE_S)), 0.1)

    poll_until(car.commands, 'a frame')
    assert {power_w for power_w, *_ in car.commands()} == {0.0}
    with commanding(3456.0):
        # In steps of 10 W, rounded down.
        car.wait_for_power(3450.0)
        commands_before = len(car.commands())
        poll_until(lambda: len(car.commands()) >= commands_before + 5, 'frames')
        heated = car.commands()[commands_before:]
    stopped = len(car.commands())
    assert all(power_w == 3450.0 and enabled for power_w, enabled, *_ in heated)
    car.wait_for_power(0.0)
    # In frames, because a busy computer sends no more frames: 15 in a lease, and one at its start.
    after = [power_w for power_w, *_ in car.commands()[stopped:]]
    assert after.index(0.0) <= LEASE_S / FRAME_PERIOD_S + 1

    with commanding(2000.0):
        car.wait_for_power(2000.0)
        # The heater's own answer: 3 is "no_flow".
        car.refusal = 3
        car.wait_for_power(0.0)
        diagnostics.wait_for(has_entry('bus_gateway: heater command', 'no_flow'))
        car.refusal = 0
        car.wait_for_power(2000.0)
    process.end()
    frames = car.commands()
    assert [power_w for power_w, *_ in frames[-3:]] == [0.0] * 3
    assert all(right for *_, right in frames)
    assert all((after[2] - before[2]) % 16 == 1 for before, after in zip(frames, frames[1:]))


def test_a_heat_source_is_commanded_by_name_and_answers(car, bench, tmp_path):
    path = can_map(tmp_path, car.ports[0].path)
    head, status, frame = path.read_text().replace('heater_status:', 'SPLIT').replace(
        'heater_command:', 'SPLIT').split('SPLIT')
    frame = frame.replace('\n', '\n    ').rstrip()
    path.write_text(f'{head.rstrip()}\n  heat_sources:\n    heat_pump:\n      status:{status.rstrip()}\n'
                    f'      command:{frame}\n')
    statuses = bench.record(HeatSourceStatus, 'heat_source_status')
    bench.start('bus_gateway', '-p', f'signals:={path}')
    commands = bench.publisher(HeatSourceCommand, 'heat_source_command', 20)
    commands.wait_for_subscription()

    def publish():
        # That of another source is not taken for its own.
        for name, power_w in (('motor', 500.0), ('heat_pump', 2000.0)):
            commands.publish(command_at(bench.now_ns, power_w, LEASE_S, HeatSourceCommand, name=name))

    with repeating(publish, 0.1):
        car.wait_for_power(2000.0)
        status = statuses.wait_for(lambda each: each.measured_power == 2000.0)
    assert (status.name, status.requested_power, status.active_power) == ('heat_pump', 2000.0, 2000.0)
    # The lease ends.
    car.wait_for_power(0.0)
    assert {power_w for power_w, *_ in car.commands()} == {0.0, 2000.0}
