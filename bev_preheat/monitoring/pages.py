# SPDX-License-Identifier: Apache-2.0
"""The HTML of the page and the files that it loads; uPlot 1.6.32 (MIT licence, LICENSE.uPlot) draws the curves."""

from __future__ import annotations

from html import escape
import json
from pathlib import Path

from bev_preheat.planning.status import Status

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
