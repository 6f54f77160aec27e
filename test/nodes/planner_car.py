# SPDX-License-Identifier: Apache-2.0
"""A planner, a cold battery and a route that needs heat at once, in a Rehearsal or over DDS."""

from contextlib import contextmanager

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import BatteryState
from std_srvs.srv import SetBool

from bev_preheat.messages.fields import time_message
from bev_preheat.numerics import NS_PER_S
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan, RouteProgress

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
STATE_PERIOD_S = 0.2
# A planner counts as ended after a lease without commands: longer than any delay on a busy computer.
LEASE_S = 5.0
QUICK = ('-p', 'command_period:=0.2', '-p', f'command_lease:={LEASE_S}', '-p', 'battery_state_timeout:=60.0',
         '-p', 'minimum_on_time:=0.0', '-p', 'minimum_off_time:=0.0', '-p', 'estimation:=false')
TOPICS = {BatteryState: ('battery_state', 1), RoutePlan: ('route_plan', LATCHED),
          RouteProgress: ('route_progress', 1)}


def stamped(message, instant_ns):
    """Return a message with the stamp of an instant [ns]."""
    message.header.stamp = time_message(round(instant_ns))
    return message


def state_at(instant_ns, **fields):
    return stamped(BatteryState(**{'temperature': -7.0, 'percentage': 0.8, **fields}), instant_ns)


def route_at(instant_ns, **fields):
    """Return a RoutePlan of 20 min, too short to reach 25 degC from -7 degC: heats at once."""
    return stamped(RoutePlan(**{
        'route_id': 'home', 'segment_duration': [30.0] * 40, 'speed': [20.0], 'propulsion_power': [20e3],
        'ambient_temperature': [-7.0], 'charging_planned': True, 'target_battery_temperature': 25.0, **fields}),
        instant_ns)


def command_at(instant_ns, power_w, lease_s=1.0, kind=HvchCommand, **fields):
    """Return a command to heat with a power [W], of an instant [ns] and with a lease [s]."""
    return stamped(kind(**{
        'battery_heating_power': power_w, 'reason': HvchCommand.HEATING,
        'valid_until': time_message(instant_ns + round(lease_s * NS_PER_S)), **fields}), instant_ns)


def heats(command):
    return command.battery_heating_power > 0.0


def is_off_for(status):
    """Return a condition: a command is 0 W for a reason."""
    return lambda command: (command.battery_heating_power, command.reason) == (0.0, int(status))


def has_entry(name, text='', level=None):
    """Return a condition: a DiagnosticArray has an entry with a name and a text, and with a level if given."""
    return lambda array: any(entry.name == name and text in entry.message and level in (None, entry.level)
                             for entry in array.status)


def set_parameters(bench, node, service=SetParameters, **values):
    """Set parameters of a node by its service; return the result of the first, or that of all atomically."""
    atomically = service is SetParametersAtomically
    response = bench.call(service, f'{node}/set_parameters{"_atomically" if atomically else ""}', service.Request(
        parameters=[Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]))
    return response.result if atomically else response.results[0]


class PlannerCar:
    """The inputs of a planner, and all that it says; `process` is the latest that was started."""

    def __init__(self, bench, namespace='', commands_alone=False, battery_topic='battery_state'):
        """Start without a planner; `commands_alone` saves the time of recording plans and diagnostics."""
        self.bench, self.process, self._namespace = bench, None, namespace
        self.commands = bench.record(HvchCommand, f'{namespace}/hvch_command', 100)
        if not commands_alone:
            self.plans = bench.record(PreheatPlan, f'{namespace}/preheat_plan', 100)
            self.diagnostics = bench.record(DiagnosticArray, '/diagnostics', 100)
        self.publishers = {
            kind: bench.publisher(kind, f'{namespace}/{battery_topic if kind is BatteryState else topic}', qos)
            for kind, (topic, qos) in TOPICS.items()}

    @property
    def now_ns(self):
        """Return the time [ns]."""
        return self.bench.now_ns

    def start(self, *arguments):
        self.process = self.bench.start('planner', *arguments)
        return self.process

    def state(self, age_s=0.0, **fields):
        return state_at(self.now_ns - age_s * NS_PER_S, **fields)

    def route(self, age_s=0.0, **fields):
        return route_at(self.now_ns - age_s * NS_PER_S, **fields)

    def give(self, message):
        self.publishers[type(message)].publish(message)

    def send_state(self, **fields):
        self.give(self.state(**fields))

    def send_route(self, **fields):
        self.give(self.route(**fields))

    def feeding(self, make_state=None, period_s=STATE_PERIOD_S):
        """Publish battery states while time passes in the block."""
        return self.bench.repeating(lambda: self.give((make_state or self.state)()), period_s)

    def clear(self):
        for recorder in (self.commands, self.plans, self.diagnostics):
            recorder.clear()

    def wait_for_heat(self):
        self.commands.clear()
        return self.commands.wait_for(heats, 'heat')

    def entry(self, name, condition=lambda entry: True, node='planner'):
        """Return the first entry of a node's diagnostics with a name for which a condition holds."""
        full_name = f'{self._namespace}/{node}: {name}'.lstrip('/')

        def found(array):
            return next((each for each in array.status if each.name == full_name and condition(each)), None)
        return found(self.diagnostics.wait_for(found, f'an entry {name}'))

    def enable(self, is_on):
        return self.bench.call(SetBool, f'{self._namespace}/planner/enable', SetBool.Request(data=is_on))

    def set(self, service=SetParameters, **values):
        return set_parameters(self.bench, f'{self._namespace}/planner', service, **values)

    # In a rehearsal

    def at(self, now_ns):
        """Set the time [ns]; no timer fires."""
        self.bench.now_ns = round(now_ns)

    def after_state(self, now_ns, **fields):
        """Set the time [ns], publish a state of then, and return the command that answers."""
        self.at(now_ns)
        self.send_state(**fields)
        return self.commands.latest

    def repeat(self):
        self.bench.fire_all()


@contextmanager
def driving(bench):
    """Publish battery states continuously, and a latched route that needs heat at once; give the PlannerCar."""
    car = PlannerCar(bench)
    car.send_route()
    with car.feeding():
        yield car


def values_of(entry):
    return {item.key: item.value for item in entry.values}
