# SPDX-License-Identifier: Apache-2.0
"""The tutorial docs/tutorials/from_files.md: its commands as printed, up to a planner with the identified car."""

import json
from pathlib import Path

from node_bench import repeating
import pytest
from sensor_msgs.msg import BatteryState
from typed_pages import node_commands_of, run_page

from bev_preheat.commands.main import main
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan

pytestmark = [pytest.mark.needs(package) for package in (
    'casadi', 'scipy', 'jinja2', 'matplotlib')]
PAGE = Path(__file__).parents[2] / 'docs/tutorials/from_files.md'
# The state of the tutorial's `preheat plan`.
TEMPERATURE_C, SOC, AMBIENT_C = 14.0, 0.82, -3.0


def heating_wh(vehicle):
    """Return the heater's energy [Wh] in the plan of `preheat plan` with a vehicle file of the tutorial."""
    assert main(['plan', '--vehicle', vehicle, '--route', 'to_work.gpx', '--ambient', f'{AMBIENT_C:g}',
                 '--temperature', f'{TEMPERATURE_C:g}', '--soc', f'{SOC:g}', '--json', 'plan.json']) == 0
    return json.loads(Path('plan.json').read_text())['energy_wh']['hvch_electric']


@pytest.mark.deep
def test_commands_as_printed_lead_to_a_planner_with_the_identified_car(bench, tmp_path, monkeypatch, capfd):
    run_page(PAGE, tmp_path, monkeypatch, capfd)
    own_wh, data_sheet_wh = heating_wh('my_car.yaml'), heating_wh('data_sheet.yaml')

    commands, plans = bench.record(HvchCommand, 'hvch_command'), bench.record(PreheatPlan, 'preheat_plan')
    sender = bench.publisher(BatteryState, 'battery_state')

    def tell_battery_state():
        state = BatteryState(temperature=TEMPERATURE_C, percentage=SOC, voltage=371.0, current=-4.0, present=True)
        state.header.stamp = bench.node.get_clock().now().to_msg()
        sender.publish(state)

    words = node_commands_of(PAGE.read_text())
    assert [name for name, _ in words] == ['planner', 'route_publisher']
    for name, ros_arguments in words:
        # A state may be late on a busy computer.
        bench.start(name, *ros_arguments, *(['-p', 'battery_state_timeout:=60.0'] if name == 'planner' else []))
    with repeating(tell_battery_state, 0.2):
        plan = plans.wait_for(lambda plan: plan.status == Status.WAITING, 'a plan that waits')
        command = commands.wait_for(lambda command: command.reason == Status.WAITING, 'its command')
    assert plan.route_id == 'to_work'
    assert plan.predicted_arrival_temperature == pytest.approx(25.0, abs=0.3)
    assert command.battery_heating_power == 0.0
    # The file that was identified: with the data sheet's car it is another plan.
    assert abs(data_sheet_wh / own_wh - 1.0) > 0.2
    assert plan.hvch_electric_energy == pytest.approx(own_wh, rel=0.05)
