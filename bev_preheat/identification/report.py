# SPDX-License-Identifier: Apache-2.0
"""The report on an identification: one HTML file without references to others."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, StrictUndefined

from bev_preheat.errors import figure
from bev_preheat.identification.uncertainty import QUANTILE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bev_preheat.identification.result import Identification

TEMPLATE = Path(__file__).with_name('report.html')


def report_text(result: Identification, pictures: Mapping[str, str]) -> str:
    """Return the report on an Identification with `pictures` (SVG elements by name)."""
    # Names of trips and vehicles come from files, so they are escaped.
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters['figure'] = lambda value: figure(value, 4)
    template = environment.from_string(TEMPLATE.read_text(encoding='utf-8'))
    return template.render(result=result, pictures=pictures, quantile=QUANTILE)
