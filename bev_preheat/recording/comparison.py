# SPDX-License-Identifier: Apache-2.0
"""Whether a replay answers as the recorded planner did, instant by instant, and the likely cause if not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.files.input_files import version
from bev_preheat.native.library import core
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.planner import METHODS
from bev_preheat.planning.status import Status
from bev_preheat.recording.flight import FLIGHT_RECORDER
from bev_preheat.recording.recorded_steps import command_values

if TYPE_CHECKING:
    from bev_preheat.control.decision import Command
    from bev_preheat.recording.flight import Flight
    from bev_preheat.recording.recorded_steps import RecordedStep

# Leases of a recording without the instants of steps may end this much apart [ns].
LEASE_TOLERANCE_NS = 1_000_000


class Difference(NamedTuple):
    """The first step that was answered differently: its number, its instant [ns], and both answers as text."""

    number: int
    now_ns: int
    recorded: str
    replayed: str


@dataclass
class Comparison:
    """
    `commands` recorded commands were compared, `different` commands differ, `first` is the first Difference.

    `largest_w` is the largest difference of power [W], `tolerance_w` [W] the tolerated difference: above 0 the
    recording has no steps of its own, and steps without a recorded command are not compared.
    """

    commands: int = 0
    different: int = 0
    first: Difference | None = None
    largest_w: float = 0.0
    tolerance_w: float = 0.0

    @property
    def is_reproduced(self) -> bool:
        """Whether every command is the recorded one."""
        return self.different == 0

    def add(self, number: int, step: RecordedStep, command: Command | None) -> None:
        """Compare the replayed command of a step: its power, the end of its lease and its reason."""
        recorded, replayed = step.command, command_values(command)
        if recorded is None and (replayed is None or self.tolerance_w > 0.0):
            return
        self.commands += 1
        if recorded is not None and replayed is not None:
            self.largest_w = max(self.largest_w, abs(recorded[0] - replayed[0]))
            if recorded == replayed or (self.tolerance_w > 0.0 and _are_near(
                    recorded, replayed, self.tolerance_w)):
                return
        self.different += 1
        if self.first is None:
            self.first = Difference(number, step.now_ns, *_both_in_words(recorded, replayed))


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
    """Return a command as text."""
    if command is None:
        return 'no command'
    power_w, _, reason = command
    return f'{power_w:.1f} W ({Status(reason).name})'


def cause_of(flight: Flight, first: Difference) -> str:
    """Return the likely cause of the first Difference, as a sentence."""
    beginning, parameters = flight.beginning, flight.beginning.parameters
    if flight.source != FLIGHT_RECORDER:
        return ('The recording has no vehicle file, parameters and learned factors: compare those of the recorded '
                'planner with --vehicle, --method and --set.')
    if any(gap <= first.number and not any(gap <= start.at <= first.number for start in flight.starts)
           for gap in flight.gaps):
        return 'Steps before it were not recorded, so the replayed planner knows less.'
    if beginning.version != version():
        return f'Version {beginning.version} recorded it, and version {version()} replays it.'
    method = str(parameters.get('method', ''))
    if method and method not in METHODS:
        return f'The method {method} comes from an installed package, and may depend on more than its inputs.'
    if parameters.get('compiled_core', True) and core() is None:
        return 'The native core is not built here, and the recorded planner may have used it.'
    return ('None is known: version, parameters, vehicle file and inputs are the recorded ones. The file may '
            'have been changed, or the computer computes otherwise.')
