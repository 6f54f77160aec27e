# SPDX-License-Identifier: Apache-2.0
"""Texts of message types with all that they contain, as recordings hold them."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.files.configuration import installed_prefix

if TYPE_CHECKING:
    from collections.abc import Iterator

SEPARATOR = '=' * 80
# A field's type: package/Type or Type, with or without bounds of an array or a text.
FIELD = re.compile(r'^\s*(?:(?P<package>\w+)/)?(?P<name>[A-Z]\w*)(?:\[[^\]]*\])?\s+\w+')


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
