# SPDX-License-Identifier: Apache-2.0
"""Cell data that `preheat vehicle new` assumes by chemistry; figures, units and sources are in chemistry.yaml."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from types import SimpleNamespace

import yaml

CHEMISTRIES = ('nmc', 'lfp')
FIGURES = Path(__file__).with_name('chemistry.yaml')


class Chemistry(SimpleNamespace):
    """Figures of chemistry.yaml: its keys are attributes, of tables in it, too."""


@cache
def load_chemistry(name: str) -> Chemistry:
    """Return the Chemistry of one of CHEMISTRIES."""
    figures = yaml.safe_load(FIGURES.read_text(encoding='utf-8'))[name]
    return Chemistry(**{key: Chemistry(**value) if isinstance(value, dict) else value
                        for key, value in figures.items()})
