# SPDX-License-Identifier: Apache-2.0
"""Whether a replay answers as the recorded planner did, instant by instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.flight_recorder.steps import command_values
from bev_preheat.planning.status import Status

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bev_preheat.replay.flight_file import Given
    from bev_preheat.replay.player import Played


class Difference(NamedTuple):
    """The first step that was answered differently: its number, its instant [ns], and both answers in words."""

    number: int
    now_ns: int
    recorded: str
    replayed: str


@dataclass(frozen=True)
class Comparison:
    """
    `commands` recorded commands were compared, `different` of them differ, `first` is the first Difference.

    `largest_w` is the largest difference of power [W].
    """

    commands: int
    different: int
    first: Difference | None
    largest_w: float = 0.0

    @property
    def is_reproduced(self) -> bool:
        """Whether every command is the recorded one."""
        return self.different == 0


def compare(pairs: Iterable[tuple[Given, Played]]) -> Comparison:
    """
    Return the Comparison of recorded steps with their replays.

    A command differs if its power, the end of its lease or its reason does.
    """
    commands = different = 0
    first: Difference | None = None
    largest_w = 0.0
    for index, (given, played) in enumerate(pairs):
        recorded, replayed = given.step.command, command_values(played.output.command)
        if recorded is None and replayed is None:
            continue
        commands += 1
        if recorded is not None and replayed is not None:
            largest_w = max(largest_w, abs(recorded[0] - replayed[0]))
            if recorded == replayed:
                continue
        different += 1
        if first is None:
            first = Difference(index, given.step.now_ns, in_words(recorded), in_words(replayed))
    return Comparison(commands, different, first, largest_w)


def in_words(command: tuple[float, int, int] | None) -> str:
    """Return a command in words."""
    if command is None:
        return 'no command'
    power_w, _, reason = command
    return f'{power_w:.1f} W ({Status(reason).name})'
