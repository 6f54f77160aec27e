# SPDX-License-Identifier: Apache-2.0
"""The log of a heater controller when refusals begin and end."""

from bev_preheat.nodes.heater_execution import RefusalNews
from bev_preheat.vehicle.heater_controller import HeaterAnswer, Refusal

SILENT = HeaterAnswer(0.0, 0.0, Refusal.NO_COMMAND, 'no valid command is in force')
SERVED = HeaterAnswer(2500.0, 2500.0)
CONFLICT = HeaterAnswer(0.0, 0.0, Refusal.COMMAND_CONFLICT, '2 nodes command the heater')
LIMITED = HeaterAnswer(2500.0, 2000.0, Refusal.CABIN_FIRST, 'the cabin leaves 2000 W')


def test_a_refusal_is_told_when_it_begins_and_when_it_is_over():
    news = RefusalNews()
    told = [news.sentence(answer)
            for answer in (SILENT, SERVED, SERVED, CONFLICT, CONFLICT, SERVED, LIMITED, SERVED)]
    assert [sentence for _, sentence in told] == [
        '', '', '', 'COMMAND_CONFLICT: 2 nodes command the heater', '',
        'COMMAND_CONFLICT is over; the command is served', '', '']
    assert [is_refused for is_refused, _ in told][3:6] == [True, True, False]


def test_a_refusal_that_follows_another_names_both():
    news = RefusalNews()
    news.sentence(CONFLICT)
    assert news.sentence(SILENT) == (
        True, 'COMMAND_CONFLICT is over; NO_COMMAND: no valid command is in force')
