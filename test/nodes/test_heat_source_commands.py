# SPDX-License-Identifier: Apache-2.0
"""Heat sources beside the HVCH over DDS: installed planner, heater_controller of one source, simulated vehicle."""

from bev_preheat_msgs.msg import HeatSourceCommand, HeatSourceStatus, HvchCommand

ROUTE = ('duration_s,speed_mps,propulsion_power_w,ambient_temperature_c\n' + '60.0,15.0,9000.0,-5.0\n' * 3)
CAR = '-p', 'vehicle:=heat_pump_car'


def test_each_source_is_commanded_obeys_and_answers(bench, tmp_path):
    route = tmp_path / 'short.csv'
    route.write_text(ROUTE)
    commands = bench.record(HeatSourceCommand, 'heat_source_command', qos=20)
    statuses = bench.record(HeatSourceStatus, 'heat_source_status', qos=20)
    of_hvch = bench.record(HvchCommand, 'hvch_command')
    bench.start('planner', *CAR, '-p', 'use_sim_time:=true')
    bench.start('heater_controller', *CAR, '-p', 'use_sim_time:=true', '-p', 'heat_source:=heat_pump')
    simulator = bench.start(
        'vehicle_simulator', *CAR, '-p', f'route:={route}', '-p', 'lockstep:=true', '-p', 'exit_on_arrival:=true',
        '-p', 'initial_battery_temperature:=-8.0', '-p', 'target_battery_temperature:=20.0')
    heating = {name: commands.wait_for(
        lambda each, name=name: each.name == name and each.battery_heating_power > 0.0)
        for name in ('motor', 'heat_pump')}
    hvch = of_hvch.wait_for(lambda each: each.battery_heating_power > 0.0)
    assert {each.reason for each in heating.values()} == {hvch.reason}
    assert all(each.valid_until.sec > each.header.stamp.sec for each in heating.values())
    status = statuses.wait_for(lambda each: each.active_power > 0.0)
    assert (status.name, status.active_power) == ('heat_pump', 2500.0)
    assert simulator.wait() == 0
    # 3.0 and 2.5 kW beside the 5 kW that cabin heating leaves the HVCH, for three minutes.
    assert 'of 525.0 electrical' in simulator.output()
    assert commands.wait_for(lambda each: each.reason == HvchCommand.ARRIVED).battery_heating_power == 0.0
