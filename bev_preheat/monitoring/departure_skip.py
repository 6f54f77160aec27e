# SPDX-License-Identifier: Apache-2.0
"""A client of a planner's service ~/skip_departure."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from std_srvs.srv import SetBool

from bev_preheat.errors import InvalidInput
from bev_preheat.monitoring.preparation import ANSWERED_WITHIN_S, FOUND_WITHIN_S, SPIN_PERIOD_S

if TYPE_CHECKING:
    from bev_preheat.nodes.listening import Listener


def skip_departure(listener: Listener, planner: str, is_skipped: bool) -> tuple[bool, str]:
    """
    Skip the next departure of a planner, by the full name of its node, or take back every skip.

    Returns whether it is done, and the planner's sentence. Raises InvalidInput if no planner answers.
    """
    client = listener.node.create_client(SetBool, f'{planner}/skip_departure')
    end_s = time.monotonic() + FOUND_WITHIN_S
    while not client.service_is_ready():
        if time.monotonic() > end_s:
            raise InvalidInput(f'no planner answers as {planner}: is it running, in this ROS domain and under '
                               'this name?')
        listener.listen(SPIN_PERIOD_S)
    # Sent once: a second request would skip another departure.
    answer = client.call_async(SetBool.Request(data=is_skipped))
    end_s = time.monotonic() + FOUND_WITHIN_S + ANSWERED_WITHIN_S
    while not answer.done():
        if time.monotonic() > end_s:
            raise InvalidInput(f'{planner} has not answered; `preheat monitor` shows whether the departure '
                               'is skipped')
        listener.listen(SPIN_PERIOD_S)
    response = answer.result()
    return bool(response.success), str(response.message)
