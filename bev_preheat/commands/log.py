# SPDX-License-Identifier: Apache-2.0
"""`preheat log`: describes a log: format, signals, sampling, gaps, doubts."""

from __future__ import annotations

from argparse import Namespace
from datetime import datetime, UTC
from pathlib import Path

import numpy as np

from bev_preheat.commands.output import add_output_arguments, check_output_arguments, write_results
from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.situation import add_signal_arguments
from bev_preheat.commands.terminal import print_records
from bev_preheat.drawing.inputs_figure import make_recording_figure
from bev_preheat.errors import figure, shortened
from bev_preheat.files.output_files import expanded
from bev_preheat.logs.reading import LONGEST_LIST, read_recording
from bev_preheat.logs.recording import Recording, Sampling, sampling, Series


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand to those of `preheat`."""
    parser = subparsers.add_parser(
        'log', help='describe a drive log: signals, sampling, gaps, doubts',
        description='Describe a drive log: its format, the signals found and their ranges in SI units, sampling, '
                    'gaps, and doubts about sign, unit and scale.')
    parser.add_argument('file', metavar='FILE',
                        help='log: CSV (one column a signal, or one reading a line), LeafSpy, JSON lines, MDF4, '
                        'CAN frames (candump, ASC, BLF, TRC, GVRET, CRTD) with a DBC, MCAP, rosbag2')
    add_signal_arguments(parser)
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Read the log, print and write its description, and return the exit status."""
    path = expanded(arguments.file)
    check_output_arguments(arguments, (path,))
    recording = read_recording(path, arguments.signals, arguments.repair)
    samplings = {signal: sampling(series) for signal, series in recording.signals.items()}
    console = write_results(arguments, lambda: as_dictionary(recording, samplings),
                            lambda: make_recording_figure(recording))
    begun = '' if recording.start_s is None else f', from {_moment(recording.start_s)}'
    print_records(console, f'Log {Path(path).name}',
                  ('signal', 'min', 'max', 'samples', 'every [s]', 'gaps (longest [s])'),
                  [_row(recording.signals[signal], signal, samplings[signal]) for signal in recording.signals],
                  ('left', *('right',) * 5))
    console.say(f'{recording.format}, signal map {recording.signal_map}, {recording.duration_s / 60.0:.1f} '
                f'min{begun}')
    for signal, names in recording.sources.items():
        console.say(f'{signal}: from {", ".join(names)}')
    if recording.unused:
        console.say(f'not used: {shortened(", ".join(recording.unused), LONGEST_LIST)}')
    console.say(*(f'note: {remark}' for remark in recording.remarks))
    for option, done in (('plot', 'drawn'), ('json', 'written')):
        if getattr(arguments, option) not in (None, '-'):
            console.say(f'{done}: {getattr(arguments, option)}')
    return 0


def _row(series: Series, signal: str, found: Sampling) -> tuple[str, ...]:
    return (signal, figure(float(series.value.min()), 5), figure(float(series.value.max()), 5),
            str(len(series.value)), '' if np.isnan(found.interval_s) else figure(found.interval_s, 3),
            f'{found.gaps} ({figure(found.longest_gap_s, 3)})' if found.gaps else '')


def as_dictionary(recording: Recording, samplings: dict[str, Sampling]) -> dict[str, object]:
    """Return the description of a recording for JSON."""
    return {
        'format': recording.format, 'signal_map': recording.signal_map,
        'start': None if recording.start_s is None else _moment(recording.start_s),
        'duration_s': recording.duration_s,
        'signals': {signal: {'min': float(series.value.min()), 'max': float(series.value.max()),
                             'samples': len(series.value)} for signal, series in recording.signals.items()},
        'sources': {signal: list(names) for signal, names in recording.sources.items()},
        'unused': list(recording.unused),
        'sampling': {signal: {
            'interval_s': None if np.isnan(found.interval_s) else found.interval_s, 'gaps': found.gaps,
            'longest_gap_s': found.longest_gap_s} for signal, found in samplings.items()},
        'remarks': list(recording.remarks)}


def _moment(start_s: float) -> str:
    return datetime.fromtimestamp(start_s, UTC).strftime('%Y-%m-%d %H:%M:%S UTC')
