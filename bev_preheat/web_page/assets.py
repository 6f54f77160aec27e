# SPDX-License-Identifier: Apache-2.0
"""The files that a web page embeds; uPlot 1.6.32 (MIT licence, LICENSE.uPlot) draws the curves."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).with_name('assets')


def asset(name: str) -> str:
    """Return the text of an embedded file, such as `uPlot.iife.min.js`; FileNotFoundError if there is none."""
    return (FOLDER / name).read_text(encoding='utf-8')
