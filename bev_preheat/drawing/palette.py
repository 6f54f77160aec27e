# SPDX-License-Identifier: Apache-2.0
"""
Style of each method and each quantity, the same in every figure.

The colours are those of Okabe and Ito, distinguishable with any colour vision; dashes and markers distinguish
methods in black and white. Methods drawn later are thinner: if curves coincide,
the wider one below shows on both sides and through the gaps of the one above.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

# Arguments of matplotlib by name.
Style = dict[str, Any]

BLACK, GRAY = '#000000', '#767676'
BLUE, SKY_BLUE, GREEN = '#0072B2', '#56B4E9', '#009E73'
ORANGE, VERMILLION, PURPLE = '#E69F00', '#D55E00', '#CC79A7'

# Quantities and bounds that belong to no method.
TARGET: Style = {'color': BLACK, 'linewidth': 0.9, 'linestyle': (0, (4.0, 2.0)), 'zorder': 4.0}
# Wide and pale, below everything, because a battery may be as cold as its surroundings.
AMBIENT: Style = {'color': SKY_BLUE, 'alpha': 0.6, 'linewidth': 4.0, 'zorder': 1.0,
                  'solid_capstyle': 'butt', 'label': 'ambient'}
PREDICTION = PURPLE
# Likewise, because the heater mostly runs at its limit.
HEATER_LIMIT: Style = {'color': GRAY, 'alpha': 0.35, 'linewidth': 6.0, 'zorder': 1.0,
                       'solid_capstyle': 'butt', 'label': 'maximum after cabin heating'}
DRIVETRAIN: Style = {'color': VERMILLION, 'alpha': 0.55, 'linewidth': 2.6, 'zorder': 2.0,
                     'label': 'drivetrain'}
# Of a vehicle with several heat sources, the HVCH first.
HEAT_SOURCES = VERMILLION, BLUE, GREEN, ORANGE, PURPLE, GRAY
ROUTE = GRAY
POWER = VERMILLION
CHARGE_LIMIT = SKY_BLUE
DISCHARGE_LIMIT = VERMILLION
RESERVE = VERMILLION
WANTED = GRAY
STOP = ORANGE

WITHOUT_PREHEATING = 'without preheating'
LINES_ZORDER = 3.0


@dataclass(frozen=True)
class Look:
    """Colour, dashes and width [points] of a method's lines, its marker, and its name in legends ('': its own)."""

    colour: str
    dashes: str | tuple[float, tuple[float, ...]]
    width: float
    marker: str
    name: str = ''

    def line(self, **changes: Any) -> Style:
        """Return the arguments of a line, wide ones below; `changes` have precedence."""
        return {'color': self.colour, 'linestyle': self.dashes, 'linewidth': self.width,
                'zorder': LINES_ZORDER - 0.1 * self.width, **changes}


# In drawing order. The planner uses value_function, and replanned_paper is
# the paper's method in closed loop: they share these colours.
LOOKS = {
    'value_function': Look(BLUE, 'solid', 3.2, 'o', 'value_function (default)'),
    'planner': Look(BLUE, 'solid', 2.2, 'o'),
    'optimal_switch': Look(ORANGE, (0, (4.0, 2.0)), 2.2, 'x', 'optimal_switch (one switch)'),
    'paper': Look(GREEN, (0, (7.0, 2.0, 1.5, 2.0)), 1.6, '+', 'paper (published heuristic)'),
    'replanned_paper': Look(GREEN, (0, (7.0, 2.0, 1.5, 2.0)), 1.6, '+', 'published heuristic, re-planned'),
    'always_on': Look(VERMILLION, (0, (1.5, 1.5)), 1.8, 's', 'heater always on'),
    'nlp': Look(BLACK, (0, (1.2, 2.4)), 1.5, 's', 'optimum (nonlinear program)'),
    WITHOUT_PREHEATING: Look(GRAY, (0, (6.0, 3.0)), 1.3, 'v'),
}
UNKNOWN = Look(PURPLE, 'solid', 1.5, 'D')


def look_of(method: str) -> Look:
    """Return the Look of a method, also if its plan is shown as executed."""
    return LOOKS.get(method.partition(',')[0], UNKNOWN)


def name_of(method: str) -> str:
    """Return the name of a method in legends; a plan shown as driven keeps the limits."""
    name, _, driven = method.partition(', ')
    name = look_of(name).name or name
    return name + (', limits kept' if driven == 'driven' else f', {driven}' if driven else '')
