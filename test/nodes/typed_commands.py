# SPDX-License-Identifier: Apache-2.0
"""
The commands `ros2 topic pub` of a document, and the messages that ros2cli would publish for them.

No package index has ros2cli, so this follows its implementation (jazzy: ros2topic/verb/pub.py,
rosidl_runtime_py): the values are YAML, arrays are built from lists, `header: auto` is the publisher's time
at each message, and the quality of service is the profile `default`.
"""

from dataclasses import dataclass
from importlib import import_module
import re
import shlex

from rclpy.qos import QoSPresetProfiles
import yaml

QOS = QoSPresetProfiles.get_from_short_key('default')


@dataclass(frozen=True)
class Typed:
    """One command: whether it publishes once, the topic, the message's class, and its values."""

    once: bool
    topic: str
    message_type: type
    values: dict

    def message(self, stamp):
        """Return the message that is published at an instant (builtin_interfaces/Time)."""
        message = self.message_type()
        for name, value in self.values.items():
            field = getattr(message, name)
            if name == 'header' and value == 'auto':
                message.header.stamp = stamp
            elif hasattr(field, 'typecode'):
                setattr(message, name, type(field)(field.typecode, value))
            else:
                setattr(message, name, type(field)(value))
        return message


def typed_commands(text):
    """Return the commands `ros2 topic pub` in the code blocks of a Markdown text, in order."""
    blocks = re.findall(r'^```\w*\n(.*?)^```', text, re.MULTILINE | re.DOTALL)
    # A backslash continues on the next line.
    lines = '\n'.join(blocks).replace('\\\n', ' ').splitlines()
    return [_typed(shlex.split(line, comments=True)[3:]) for line in lines
            if line.startswith('ros2 topic pub ')]


def _typed(words):
    once = words[0] == '--once'
    topic, kind, values = words[once:]
    package, _, name = kind.split('/')
    return Typed(once, topic, getattr(import_module(f'{package}.msg'), name),
                 yaml.safe_load(values))
