# SPDX-License-Identifier: Apache-2.0
"""
Whether a replay answers as the recorded planner did, and the likely cause if not; or gives the expected figures.

Expected figures have tolerances, for continuous integration. Commands must agree to the last digit, those of a
recording of `ros2 bag` to `Flight.power_tolerance_w`.
"""

from __future__ import annotations

from dataclasses import dataclass
import difflib
from itertools import pairwise
import json
import math
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.input_files import read_text, version
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.planner import METHODS
from bev_preheat.planning.status import Status
from bev_preheat.recording.flight import FLIGHT_RECORDER
from bev_preheat.recording.records import command_values
from bev_preheat.vehicle.core_library import core
from bev_preheat.vehicle.description import HVCH

if TYPE_CHECKING:
    from bev_preheat.control.decision import Command
    from bev_preheat.recording.course import Course, Instant
    from bev_preheat.recording.flight import Flight
    from bev_preheat.recording.records import RecordedStep

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
        """Compare the replayed command of a step: its powers, the end of its lease and its reason."""
        recorded, replayed = step.command, command_values(command)
        sources = () if command is None else command.sources_w
        if recorded is None and (replayed is None or self.tolerance_w > 0.0):
            return
        self.commands += 1
        if recorded is not None and replayed is not None and command is not None:
            names = HVCH, *dict((*step.sources, *sources))
            off_w = max(abs(step.command_w(name) - command.power_w(name)) for name in names)
            self.largest_w = max(self.largest_w, off_w)
            is_same = recorded == replayed and step.sources == sources
            if is_same or (off_w <= self.tolerance_w > 0.0 and recorded[2] == replayed[2]
                           and abs(recorded[1] - replayed[1]) <= LEASE_TOLERANCE_NS):
                return
        self.different += 1
        if self.first is None:
            texts = _both_in_words(recorded, replayed) if step.sources == sources else (
                f'{in_words(recorded)}, {dict(step.sources)}', f'{in_words(replayed)}, {dict(sources)}')
            self.first = Difference(number, step.now_ns, *texts)


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


FIGURES_FORMAT = 1
SAMPLE_NS = 60 * NS_PER_S
# Tolerances that `figures` are written with; the others are compared as they are.
ENERGY = '_wh'
TOLERANCES = {
    ENERGY: 20.0,
    'heating_begins_s': 30.0, 'heating_ends_s': 30.0, 'arrival_s': 10.0,
    'arrival_temperature_c': 0.3, 'last_predicted_arrival_temperature_c': 0.3, 'minute_command_w': 100.0,
    'minute_measured_c': 0.3, 'minute_predicted_c': 0.3, 'largest_difference_w': 1.0}


class Deviation(NamedTuple):
    """A figure that is not as expected: its name, its value, the expected one, and the tolerance, all as text."""

    field: str
    value: str
    expected: str
    tolerance: str

    def sentence(self) -> str:
        """Return it as text."""
        return f'{self.field}: {self.value}, expected {self.expected}, tolerance {self.tolerance}'


def figures(comparison: Comparison | None, course: Course) -> dict[str, Any]:
    """Return the figures of a replay by name (`minute_...`: of each full minute); None: unknown, or never."""
    start_ns = course.instants[0].now_ns
    heating = course.heating

    def seconds(now_ns: int | None) -> float | None:
        return None if now_ns is None else (now_ns - start_ns) / NS_PER_S

    arrival, predicted = course.arrival, course.latest_prediction
    minutes = _minutes(course)
    return {
        **({} if comparison is None else {
            'reproduced': comparison.is_reproduced, 'commands': comparison.commands,
            'different': comparison.different, 'largest_difference_w': comparison.largest_w}),
        'heating_begins_s': seconds(heating[0].from_ns if heating else None),
        'heating_ends_s': seconds(heating[-1].to_ns if heating else None),
        'switch_ons': len(heating),
        **course.results.energies_wh,
        'arrival_s': seconds(None if arrival is None else arrival.now_ns),
        'arrival_temperature_c': _known(None if arrival is None else arrival.measured_c),
        'last_predicted_arrival_temperature_c': _known(None if predicted is None else predicted.predicted_c),
        'statuses': [said.status.name for said in course.said],
        'regimes': [regime for _, regime in course.regimes],
        'signals_in_doubt': [names for _, names in course.signals if names],
        'minute_command_w': [instant.command_w for instant in minutes],
        'minute_measured_c': [_known(instant.measured_c) for instant in minutes],
        'minute_predicted_c': [_known(instant.predicted_c) for instant in minutes]}


def _known(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else value


def _minutes(course: Course) -> list[Instant]:
    """Return the latest Instant at each full minute from the start on."""
    found: list[Instant] = []
    due_ns = course.instants[0].now_ns
    for latest, following in pairwise(course.instants):
        while following.now_ns > due_ns:
            found.append(latest)
            due_ns += SAMPLE_NS
    if course.instants[-1].now_ns == due_ns:
        found.append(course.instants[-1])
    return found


def expectation(values: dict[str, Any]) -> dict[str, Any]:
    """Return what `--write-expected` writes of `figures`: each with its usual tolerance."""
    return {'format': FIGURES_FORMAT, 'expected': {
        name: {'value': _rounded(value), **({'tolerance': TOLERANCES[kind]} if kind in TOLERANCES else {})}
        for name, value in values.items() for kind in [ENERGY if name.endswith(ENERGY) else name]}}


def _rounded(value: Any) -> Any:
    if isinstance(value, list):
        return [_rounded(each) for each in value]
    return round(value, 3) if isinstance(value, float) else value


def load_expectation(path: str | Path) -> dict[str, tuple[Any, float]]:
    """Return value and tolerance of each figure in a file; raises InvalidInput, naming file and figure."""
    text = read_text(path)
    try:
        contents = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f'{path}: is not JSON: {error}') from error
    number = contents.get('format') if isinstance(contents, dict) else None
    if number != FIGURES_FORMAT:
        raise InvalidInput(f'{path}: has format {quoted(str(number))}; this version reads format {FIGURES_FORMAT} '
                           '(preheat replay --write-expected)')
    expected = contents.get('expected')
    if not isinstance(expected, dict) or not expected:
        raise InvalidInput(f'{path}: expected: has no figure, so that nothing would be checked')
    return {name: _entry(path, name, entry) for name, entry in expected.items()}


def _entry(path: str | Path, name: str, entry: Any) -> tuple[Any, float]:
    if not isinstance(entry, dict) or 'value' not in entry:
        raise InvalidInput(f'{path}: {name}: has no value; it must be {{"value": ..., "tolerance": ...}}')
    tolerance = entry.get('tolerance', 0.0)
    if isinstance(tolerance, bool) or not isinstance(tolerance, int | float) or not 0.0 <= tolerance < math.inf:
        raise InvalidInput(f'{path}: {name}: tolerance: {quoted(str(tolerance))} is not allowed; it must be '
                           'a number of at least 0')
    return entry['value'], float(tolerance)


def deviations(expected: dict[str, tuple[Any, float]], values: dict[str, Any]) -> list[Deviation]:
    """
    Return the Deviations of `figures` from an expectation, in its order; [] if all are as expected.

    Raises InvalidInput, naming an expected figure that a replay does not have.
    """
    for name in expected.keys() - values.keys():
        near = difflib.get_close_matches(name, values, 1)
        raise InvalidInput(f'--expect: {quoted(name)} is no figure of this replay' + (
            f'; is {near[0]} meant?' if near else f'; figures are {", ".join(values)}'))
    return [found for name, (wanted, tolerance) in expected.items()
            if (found := _deviation(name, values[name], wanted, tolerance)) is not None]


def _deviation(name: str, value: Any, wanted: Any, tolerance: float) -> Deviation | None:
    """Return the Deviation of a value, of two lists the first one; None without."""
    if isinstance(wanted, list) and isinstance(value, list):
        items = (_deviation(f'{name}[{index}]', *both, tolerance) for index, both in enumerate(zip(value, wanted)))
        first = next(filter(None, items), None)
        if first is None and len(value) != len(wanted):
            return Deviation(name, f'{len(value)} values', f'{len(wanted)} values', '0')
        return first
    if _is_near(value, wanted, tolerance):
        return None
    return Deviation(name, _words(value), _words(wanted), f'{tolerance:g}')


def _is_near(value: Any, wanted: Any, tolerance: float) -> bool:
    numbers = [each for each in (value, wanted) if isinstance(each, int | float) and not isinstance(each, bool)]
    if len(numbers) == 2:
        # A NaN is near to nothing.
        return abs(numbers[0] - numbers[1]) <= tolerance
    return type(value) is type(wanted) and bool(value == wanted)


def _words(value: Any) -> str:
    if value is None:
        return 'none'
    return f'{value:.6g}' if isinstance(value, float) else json.dumps(value)
