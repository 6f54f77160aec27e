# SPDX-License-Identifier: Apache-2.0
"""The order of the examples in the gallery; Sphinx refuses a function in conf.py itself, because it cannot cache it."""

from pathlib import Path

ORDER = ('table_two', 'when_to_heat', 'alpine_pass', 'wrong_model', 'own_vehicle', 'charger_minute', 'fleet')


def place_of(file):
    """Return the place of an example in the gallery; examples that are not in ORDER come last."""
    name = Path(file).stem
    return ORDER.index(name) if name in ORDER else len(ORDER)
