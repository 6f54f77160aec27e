# SPDX-License-Identifier: Apache-2.0
"""Print the assessment of a soak test."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.console.terminal import print_records

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from bev_preheat_studies.soak.assessment import Assessment


def tell(console: Console, name: str, title: str, assessments: Sequence[Assessment]) -> bool:
    """Print the Assessments of the soak test `name`; return whether all are good."""
    print_records(console, title, ('what', 'figure', 'allowed', ''), [
        (item.what, item.value, item.allowed,
         '' if not item.allowed else 'good' if item.good else 'BAD') for item in assessments])
    good = all(item.good for item in assessments)
    console.print(f'{name}: {"good" if good else "failed"}', style='green' if good else 'red')
    return good
