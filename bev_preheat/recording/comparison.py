# SPDX-License-Identifier: Apache-2.0
"""Whether a replay answers as the recorded planner did, instant by instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat.recording.period import Period, WHOLE
from bev_preheat.recording.recorded_steps import command_values

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bev_preheat.recording.flight_file import Given
    from bev_preheat.recording.player import Played


# Leases of a recording without the instants of steps may end this much apart [ns].
LEASE_TOLERANCE_NS = 1_000_000


class Difference(NamedTuple):
    """The first step that was answered differently: its number, its instant [ns], and both answers in words."""

    number: int
    now_ns: int
    recorded: str
    replayed: str


@dataclass(frozen=True)
class Comparison:
    """
    `commands` recorded commands were compared, `different` commands differ, `first` is the first Difference.

    `largest_w` is the largest difference of power [W], `tolerance_w` [W] the tolerated difference.
    """

    commands: int
    different: int
    first: Difference | None
    largest_w: float = 0.0
    tolerance_w: float = 0.0

    @property
    def is_reproduced(self) -> bool:
        """Whether every command is the recorded one."""
        return self.different == 0


def compare(pairs: Iterable[tuple[Given, Played]], period: Period = WHOLE, tolerance_w: float = 0.0,
            has_commands: bool = True) -> Comparison:
    """
    Return the Comparison of recorded steps with their replays, in a Period.

    A command differs if its power, the end of its lease or its reason does. With `tolerance_w` [W] above 0 the
    recording has no steps of its own: steps without a recorded command are not compared. Without `has_commands`
    nothing is.
    """
    commands = different = 0
    first: Difference | None = None
    largest_w = 0.0
    for index, (given, played) in enumerate(pairs):
        recorded, replayed = given.step.command, command_values(played.output.command)
        if not has_commands or not period.has(given.step.now_ns) or (
                recorded is None and (replayed is None or tolerance_w > 0.0)):
            continue
        commands += 1
        if recorded is not None and replayed is not None:
            largest_w = max(largest_w, abs(recorded[0] - replayed[0]))
            if recorded == replayed or (tolerance_w > 0.0 and _are_near(recorded, replayed, tolerance_w)):
                continue
        different += 1
        if first is None:
            first = Difference(index, given.step.now_ns, *_both_in_words(recorded, replayed))
    return Comparison(commands, different, first, largest_w, tolerance_w)


def _are_near(recorded: tuple[float, int, int], replayed: tuple[float, int, int], tolerance_w: float) -> bool:
    return (abs(recorded[0] - replayed[0]) <= tolerance_w and recorded[2] == replayed[2]
            and abs(recorded[1] - replayed[1]) <= LEASE_TOLERANCE_NS)


def _both_in_words(recorded: tuple[float, int, int] | None,
                   replayed: tuple[float, int, int] | None) -> tuple[str, str]:
    texts = in_words(recorded), in_words(replayed)
    if texts[0] != texts[1] or recorded is None or replayed is None:
        return texts
    # The difference is behind the shown digits.
    if recorded[1] != replayed[1]:
        lease_s = (replayed[1] - recorded[1]) / NS_PER_S
        order = 'later' if lease_s > 0.0 else 'earlier'
        return texts[0], f'{texts[1]}, with a lease that ends {abs(lease_s):.3f} s {order}'
    return f'{recorded[0]!r} W ({Status(recorded[2]).name})', f'{replayed[0]!r} W ({Status(replayed[2]).name})'


def in_words(command: tuple[float, int, int] | None) -> str:
    """Return a command in words."""
    if command is None:
        return 'no command'
    power_w, _, reason = command
    return f'{power_w:.1f} W ({Status(reason).name})'
