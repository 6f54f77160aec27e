# SPDX-License-Identifier: Apache-2.0
"""
The order of the examples in the gallery.

A module of its own, because Sphinx can cache neither functions nor classes of conf.py.
"""

from pathlib import Path

ORDER = ('table_two', 'when_to_heat', 'alpine_pass', 'wrong_model', 'own_vehicle', 'charger_minute', 'fleet')


def place_of(file):
    """Return the place of an example in the gallery; examples that are not in ORDER come last."""
    name = Path(file).stem
    return ORDER.index(name) if name in ORDER else len(ORDER)
