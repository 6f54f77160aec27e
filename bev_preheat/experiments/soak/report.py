# SPDX-License-Identifier: Apache-2.0
"""Tells what the figures of a soak test amount to."""

from bev_preheat.console.terminal import print_records


def tell(console, name, title, judgements):
    """Print the Judgements of a soak test of this name; return whether all are good."""
    print_records(console, title, ('what', 'figure', 'allowed', ''), [
        (item.what, item.value, item.allowed,
         '' if not item.allowed else 'good' if item.good else 'BAD') for item in judgements])
    good = all(item.good for item in judgements)
    console.print(f'{name}: {"good" if good else "failed"}', style='green' if good else 'red')
    return good
