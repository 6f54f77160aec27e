# SPDX-License-Identifier: Apache-2.0
"""Values of a vehicle file replaced by their dotted keys."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

import yaml

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


def with_keys(text: str, values: Mapping[str, Any]) -> str:
    """
    Return the text of a vehicle file with other values, such as {'hvch.maximum_power_w': 5000.0}.

    Keys need not be in the file; the schema of vehicle files decides whether they are allowed.
    """
    if not values:
        return text
    contents = yaml.safe_load(text)
    for key, value in values.items():
        *above, last = key.split('.')
        node = contents
        for name in above:
            if not isinstance(node.get(name), dict):
                node[name] = {}
            node = node[name]
        node[last] = value
    return str(yaml.safe_dump(contents, sort_keys=False))


def keys_of_text(text: str) -> list[str]:
    """Return the dotted keys of the single values of a vehicle file."""
    return list(_keys(yaml.safe_load(text)))


def _keys(node: dict[str, Any], above: str = '') -> Iterator[str]:
    for name, item in node.items():
        if isinstance(item, dict):
            yield from _keys(item, f'{above}{name}.')
        elif not isinstance(item, list):
            yield f'{above}{name}'
