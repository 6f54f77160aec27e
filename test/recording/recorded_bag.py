# SPDX-License-Identifier: Apache-2.0
"""Recordings as `ros2 bag` writes them, of the drives of recorded_drive: MCAP and SQLite."""

import sqlite3

from mcap.writer import Writer
from rclpy.serialization import serialize_message

from bev_preheat.control.decision import Command
from bev_preheat.messages.heater import command_message, source_messages
from bev_preheat.planning.status import Status
from bev_preheat.recording.flight import read_flight
from bev_preheat.recording.records import definition
from bev_preheat.vehicle import load_vehicle

TYPES = {'battery_state': 'sensor_msgs/msg/BatteryState', 'route_plan': 'bev_preheat_msgs/msg/RoutePlan',
         'hvch_command': 'bev_preheat_msgs/msg/HvchCommand',
         'heat_source_command': 'bev_preheat_msgs/msg/HeatSourceCommand'}
# The first minutes of the drive are enough.
STEPS = 500
# A recorder notes a message this much after it was sent [ns].
LATE_NS = 3_000_000


def topic_messages(folder, prefix='', has_commands=True, ahead_ns=0, vehicle='reference'):
    """Yield topic, type, time of arrival [ns] and bytes; the recorder's clock is `ahead_ns` [ns] behind."""
    for given in read_flight(folder).given[:STEPS]:
        step = given.step
        at_ns = step.now_ns - ahead_ns
        if given.message is not None:
            type_name, data = given.message
            topic = next(name for name, each in TYPES.items() if each == type_name)
            # Messages carry stamps of a moment before their step.
            yield f'{prefix}/{topic}', type_name, at_ns + LATE_NS // 3, data
        if step.command is not None and has_commands:
            power_w, until_ns, reason = step.command
            command = Command(power_w, until_ns, Status(reason), step.sources)
            for message in source_messages(command, load_vehicle(vehicle), step.now_ns):
                data = bytes(serialize_message(message))
                yield f'{prefix}/heat_source_command', TYPES['heat_source_command'], at_ns + LATE_NS, data
            data = bytes(serialize_message(command_message(command, step.now_ns)))
            yield f'{prefix}/hvch_command', TYPES['hvch_command'], at_ns + LATE_NS, data


def write_mcap(path, messages, definitions=None):
    """Write messages as an MCAP file with chunks; `definitions` replaces the text of types."""
    with open(path, 'wb') as file:
        writer = Writer(file)
        writer.start('ros2', 'rosbag2')
        channels = {}
        for topic, type_name, at_ns, data in messages:
            if topic not in channels:
                package, _, name = type_name.partition('/msg/')
                text = (definitions or {}).get(type_name, definition(package, name))
                channels[topic] = writer.register_channel(
                    topic, 'cdr', writer.register_schema(type_name, 'ros2msg', text))
            writer.add_message(channels[topic], at_ns, data, at_ns)
        writer.finish()
    return path


def write_sqlite(folder, messages):
    """Write messages as a folder of rosbag2 with an SQLite file, as ROS 2 Humble does."""
    folder.mkdir()
    (folder / 'metadata.yaml').write_text('rosbag2_bagfile_information:\n  version: 5\n')
    base = sqlite3.connect(folder / 'drive_0.db3')
    base.execute('CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, '
                 'serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)')
    base.execute('CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, '
                 'timestamp INTEGER NOT NULL, data BLOB NOT NULL)')
    numbers = {}
    for topic, type_name, at_ns, data in messages:
        if topic not in numbers:
            numbers[topic] = len(numbers) + 1
            base.execute('INSERT INTO topics VALUES (?, ?, ?, "cdr", "")', (numbers[topic], topic, type_name))
        base.execute('INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)',
                     (numbers[topic], at_ns, data))
    base.commit()
    base.close()
    return folder
