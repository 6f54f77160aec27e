# SPDX-License-Identifier: Apache-2.0
"""The message types that recordings hold, and their texts with all that they contain, as schemas have them."""

from __future__ import annotations

import re
from typing import Any, TYPE_CHECKING

from bev_preheat.errors import InvalidInput, quoted, shortened
from bev_preheat.files.input_files import installed_prefix

if TYPE_CHECKING:
    from collections.abc import Iterator

# Of the planner's inputs and outputs, by package.
OWN = 'bev_preheat_msgs'
LONGEST_REASON = 200
SEPARATOR = '=' * 80
# A field's type: package/Type or Type, with or without bounds of an array or a text.
FIELD = re.compile(r'^\s*(?:(?P<package>\w+)/)?(?P<name>[A-Z]\w*)(?:\[[^\]]*\])?\s+\w+')


def read_message(type_name: str, data: bytes) -> Any:
    """Return the message of bytes (CDR); raises InvalidInput, naming the type, if they are damaged."""
    from rclpy.serialization import deserialize_message
    known = message_type(type_name)
    try:
        return deserialize_message(data, known)
    except Exception as error:
        # rclpy raises errors of many kinds for damaged bytes.
        reason = shortened(f'{type(error).__name__}: {" ".join(str(error).split())}', LONGEST_REASON)
        raise InvalidInput(f'a message of type {type_name} in the recording is damaged, or of another version: '
                           f'{reason}') from error


def message_type(name: str) -> Any:
    """Return the class of a message type such as sensor_msgs/msg/BatteryState; raises InvalidInput if unknown."""
    package, _, short = name.partition('/msg/')
    if package == OWN:
        import bev_preheat_msgs.msg as module
    elif package == 'sensor_msgs':
        import sensor_msgs.msg as module
    else:
        module = None
    found = getattr(module, short, None)
    if found is None:
        raise InvalidInput(f'message type {quoted(name)} of the recording is not known here')
    return found


def definition(package: str, name: str) -> bytes:
    """
    Return the text of the message type `package`/msg/`name`, and of each type in it, for schemas of kind ros2msg.

    Raises InvalidInput if the text of one is not installed.
    """
    texts: dict[tuple[str, str], str] = {}
    waiting = [(package, name)]
    while waiting:
        key = waiting.pop(0)
        if key not in texts:
            texts[key] = _text(*key)
            waiting += _contained(key[0], texts[key])
    first, *others = texts.items()
    parts = [first[1], *(f'{SEPARATOR}\nMSG: {key[0]}/{key[1]}\n{text}' for key, text in others)]
    return '\n'.join(parts).encode()


def _text(package: str, name: str) -> str:
    prefix = installed_prefix(package)
    if prefix is None:
        raise InvalidInput(f'the message definitions of {package} are not installed')
    path = prefix / 'share' / package / 'msg' / f'{name}.msg'
    try:
        return path.read_text(encoding='utf-8')
    except OSError as error:
        raise InvalidInput(f'{path}: cannot be read: {error.strerror}') from error


def _contained(package: str, text: str) -> Iterator[tuple[str, str]]:
    for line in text.splitlines():
        found = FIELD.match(line.partition('#')[0])
        if found:
            yield found['package'] or package, found['name']
