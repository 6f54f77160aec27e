# SPDX-License-Identifier: Apache-2.0
"""Heat sources beside the HVCH over DDS: installed planner, heater_controller of one source, simulated vehicle."""

from bev_preheat_msgs.msg import HeatSourceCommand, HeatSourceStatus, HvchCommand

ROUTE = ('duration_s,speed_mps,propulsion_power_w,ambient_temperature_c\n' + '60.0,15.0,9000.0,-5.0\n' * 3)
CAR = '-p', 'vehicle:=heat_pump_car'


def drive(bench, tmp_path, *parameters):
    """Start a planner and a cold car whose target asks for all the heat there is; return the simulator."""
    route = tmp_path / 'short.csv'
    route.write_text(ROUTE)
    bench.start('planner', *CAR, '-p', 'use_sim_time:=true')
    return bench.start(
        'vehicle_simulator', *CAR, '-p', f'route:={route}', '-p', 'initial_battery_temperature:=-8.0',
        '-p', 'target_battery_temperature:=20.0', *parameters)


def test_each_source_is_commanded(bench, tmp_path):
    commands = bench.record(HeatSourceCommand, 'heat_source_command', qos=20)
    of_hvch = bench.record(HvchCommand, 'hvch_command')
    simulator = drive(bench, tmp_path, '-p', 'lockstep:=true', '-p', 'exit_on_arrival:=true')
    heating = {name: commands.wait_for(
        lambda each, name=name: each.name == name and each.battery_heating_power > 0.0)
        for name in ('motor', 'heat_pump')}
    hvch = of_hvch.wait_for(lambda each: each.battery_heating_power > 0.0)
    assert {each.reason for each in heating.values()} == {hvch.reason}
    assert all(each.valid_until.sec > each.header.stamp.sec for each in heating.values())
    assert simulator.wait() == 0
    # 3.0 and 2.5 kW beside the 5 kW that cabin heating leaves the HVCH, for three minutes.
    assert 'of 525.0 electrical' in simulator.output()
    assert commands.wait_for(lambda each: each.reason == HvchCommand.ARRIVED).battery_heating_power == 0.0


def test_the_controller_of_a_source_obeys_and_answers(bench, tmp_path):
    statuses = bench.record(HeatSourceStatus, 'heat_source_status', qos=20)
    bench.start('heater_controller', *CAR, '-p', 'use_sim_time:=true', '-p', 'heat_source:=heat_pump')
    # In real time: a drive in lockstep does not wait for controllers, which refuse a command ahead of their clock.
    drive(bench, tmp_path, '-p', 'speed_up:=1.0')
    status = statuses.wait_for(lambda each: each.active_power > 0.0)
    assert (status.name, status.active_power) == ('heat_pump', 2500.0)
