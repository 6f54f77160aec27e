# SPDX-License-Identifier: Apache-2.0
"""
The HTML of the live page, and of the report on a replay: one file that works offline, with curves to zoom into.

uPlot 1.6.32 (MIT licence, LICENSE.uPlot) draws the curves.
"""

from __future__ import annotations

from array import array
import base64
from dataclasses import dataclass
from html import escape
import json
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from bev_preheat.monitoring.seen import level_name
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.status import Status

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bev_preheat.recording.history import Change, History, KeptPlan

FOLDER = Path(__file__).with_name('assets')
# Word, and shape and colour, of each status.
STATUSES = {status.name: (status.meaning.word, status.meaning.look) for status in Status}
# Names in the folder /assets and their types.
FILES = {'dashboard.css': 'text/css', 'dashboard.js': 'text/javascript', 'view.js': 'text/javascript',
         'controls.js': 'text/javascript', 'icon.svg': 'image/svg+xml', 'uPlot.min.css': 'text/css',
         'curves.css': 'text/css', 'uPlot.iife.min.js': 'text/javascript', 'curves.js': 'text/javascript'}


def asset(name: str) -> str:
    """Return the text of a file in the folder `assets`; FileNotFoundError if it is absent."""
    return (FOLDER / name).read_text(encoding='utf-8')


def file_of(name: str) -> str:
    """Return the text of a file of FILES."""
    text = asset(name)
    return text.replace('{{statuses}}', json.dumps(STATUSES)) if name == 'view.js' else text


def main_page(has_controls: bool) -> str:
    """Return the page, with buttons if planners may be asked."""
    page, controls = asset('dashboard.html'), asset('controls.html')
    return page.replace('{{controls}}', controls if has_controls else '')


def login_page(problem: str) -> str:
    """Return the page that asks for the token, with a problem as a sentence."""
    return asset('login.html').replace('{{problem}}', escape(problem))


SCRIPTS = 'uPlot.iife.min.js', 'curves.js', 'recording_report.js'
STYLES = 'uPlot.min.css', 'curves.css', 'recording_report.css'


@dataclass(frozen=True)
class ReportText:
    """
    The words of a report: its title, the verdict, a line on each of `remarks`, and the tables.

    `is_good` is None if there is nothing to reproduce. `figures` are rows of a name and a value for each of
    `courses`; `setup` are pairs of a name and a value. `lapses` are the spans without a valid command [s since
    1970].
    """

    title: str
    verdict: tuple[str, ...]
    is_good: bool | None
    courses: tuple[str, ...]
    figures: tuple[tuple[str, ...], ...]
    remarks: tuple[str, ...]
    setup: tuple[tuple[str, str], ...]
    lapses: tuple[tuple[float, float], ...] = ()


def report_text(text: ReportText, recorded: History, changed: History | None = None) -> str:
    """Return the page; `changed` is the History of the drive with changes, None without."""
    from jinja2 import Environment, StrictUndefined
    # Names and sentences come from recordings, so they are escaped.
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    template = environment.from_string(asset('recording_report.html'))
    contents = {'recorded': history_values(recorded),
                'changed': None if changed is None else history_values(changed), 'courses': list(text.courses),
                'lapses': [list(span) for span in text.lapses]}
    return template.render(
        text=text, script='\n'.join(map(asset, SCRIPTS)), style='\n'.join(map(asset, STYLES)),
        # No text of a recording can end the element.
        data=json.dumps(contents, allow_nan=False, separators=(',', ':')).replace('<', '\\u003c'))


def history_values(history: History) -> dict[str, Any]:
    """Return a History for JSON: columns in base64 of little-endian floats, changes as lists."""
    columns = history.columns
    return {
        'time': packed(columns['time'], 'd'),
        'columns': {name: packed(values, 'f') for name, values in columns.items() if name != 'time'},
        'sources': {name: packed(powers_w, 'f') for name, powers_w in history.sources.items()},
        'sentences': _changes(history.sentences), 'regimes': _changes(history.regimes),
        'doubts': _changes(history.doubts),
        'diagnostics': [[at_s, name, level_name(level), message]
                        for at_s, name, level, message in _changes(history.diagnostics)],
        'plans': [_plan_values(plan) for plan in history.plans], 'lost': history.lost}


def packed(values: Iterable[float], kind: str) -> str:
    """Return numbers as base64 of little-endian floats, of 4 ('f') or 8 bytes ('d')."""
    numbers = array(kind, values)
    if sys.byteorder == 'big':
        numbers.byteswap()
    return base64.b64encode(numbers.tobytes()).decode('ascii')


def _changes(changes: list[Change]) -> list[list[Any]]:
    return [[change.now_ns / NS_PER_S, *change.values] for change in changes]


def _plan_values(plan: KeptPlan) -> list[Any]:
    """Return instant, label, start, and times from the start, temperatures, charges and powers, packed."""
    start_s = plan.time_s[0]
    return [plan.now_ns / NS_PER_S, plan.label, start_s, packed((time_s - start_s for time_s in plan.time_s), 'f'),
            packed(plan.temperature_c, 'f'), packed(plan.soc, 'f'), packed(plan.power_w, 'f')]
