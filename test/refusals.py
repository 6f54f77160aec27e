# SPDX-License-Identifier: Apache-2.0
"""The problems that a function refuses its input for."""

import pytest

from bev_preheat.errors import InvalidInput


def problems_of(function, *arguments, **named):
    """Return the problems of the InvalidInput that a call raises."""
    with pytest.raises(InvalidInput) as refusal:
        function(*arguments, **named)
    return refusal.value.problems
