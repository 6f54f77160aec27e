# SPDX-License-Identifier: Apache-2.0
"""Finds the parts of a value that are no plain data, or can change."""

from dataclasses import fields, is_dataclass
from enum import Enum

import numpy as np


def not_plain(value, at=''):
    """Return the places in a value, with their types, of all that is not frozen plain data; [] for none."""
    if value is None or type(value) in (bool, int, float, str) or isinstance(value, Enum):
        return []
    if isinstance(value, np.ndarray):
        arrays = [value]
        while isinstance(arrays[-1].base, np.ndarray):
            arrays.append(arrays[-1].base)
        return [f'{at}: an array that can be written'] if any(array.flags.writeable for array in arrays) else []
    if isinstance(value, tuple):
        parts = zip(getattr(value, '_fields', range(len(value))), value)
    elif is_dataclass(value) and value.__dataclass_params__.frozen:
        names = [field.name for field in fields(value)]
        # A cached property stands beside the fields.
        if getattr(value, '__dict__', {}).keys() - set(names):
            return [f'{at}: {sorted(vars(value).keys() - set(names))} beside the fields']
        parts = [(name, getattr(value, name)) for name in names]
    else:
        return [f'{at}: {type(value)}']
    return [place for name, part in parts for place in not_plain(part, f'{at}.{name}')]
