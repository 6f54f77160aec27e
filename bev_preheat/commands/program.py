# SPDX-License-Identifier: Apache-2.0
"""Start and end of each program: signals, full outputs, refusals, finished results; imports nothing slow."""

from __future__ import annotations

import codecs
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
import os
import signal
import sys
from types import FrameType
from typing import Any

from bev_preheat.errors import InvalidInput, one_line, PlanningFailure
from bev_preheat.files.output_files import AnyPath, STANDARD_OUTPUT
from bev_preheat.optional_packages import advice, MissingPackage, PACKAGES

# The argument and result of signal.signal.
Handler = Callable[[int, FrameType | None], Any] | int | signal.Handlers | None

FAILED, REFUSED, INTERRUPTED = 1, 2, 130
# The third is raised by this module itself.
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
# Replacements for terminals without these characters; one for one, so that tables stay aligned.
SIMPLER = {'…': '.', '–': '-', '−': '-', '×': 'x', '±': '~', '·': '.', '²': '2', 'μ': 'u',
           'Δ': 'd'}
# After this time [s] a signal lost in a callback is raised again, until it is heard.
AGAIN_S = 0.02
READABLE = 'bev_preheat.readable'


class Interrupted(KeyboardInterrupt):
    """SIGINT or SIGTERM arrived; `kept` describes the remaining results, and may be filled later."""

    kept = ''


class WorkerLost(Exception):
    """A worker process ended by itself, or for the reason given; `kept` describes the remaining results."""

    kept = ''

    def __str__(self) -> str:
        """Return the reason; by default that a worker process was killed."""
        return str(self.args[0]) if self.args else 'a worker process was killed'


class OutputFailed(Exception):
    """Standard output cannot be written, although its reader is still there."""

    def __init__(self, error: OSError) -> None:
        super().__init__(f'standard output: cannot be written: {error.strerror}')


def run_program(name: str, load: Callable[[], Callable[[], int]], ends_process: bool) -> int:
    """
    Call `load()`, then the function that it returns, and return the exit status of the program.

    That is the function's result; 2 with a line per problem if either raises InvalidInput or PlanningFailure, 130
    with one line if SIGINT or SIGTERM interrupts it, 1 with one line if standard output is full. Lines begin with
    `name`. With `ends_process` the process must end now; otherwise its signal handlers are restored.
    """
    simplify_streams()
    heard: list[int] = []
    try:
        work = load()
        with _signals_heard(heard, ends_process):
            status = work()
        write_output()
    except SystemExit:
        # argparse has printed its help or its error.
        try:
            write_output()
        except OutputFailed as error:
            return _say(name, error)
        raise
    except BaseException as error:
        if heard or isinstance(error, KeyboardInterrupt):
            # Also if an interrupted library wrapped the signal in an exception of its own.
            say(f'{name}: interrupted {getattr(error, "kept", "")}'.rstrip())
            status = INTERRUPTED
        elif isinstance(error, BrokenPipeError):
            # Written by code outside this module and `terminal`.
            discard_output()
            status = 0
        else:
            status = _say(name, error)
    finally:
        with suppress(OutputFailed):
            write_output()
    return status


def loading(name: str) -> None:
    """Answer Ctrl-C with one line while the imports of the program `name` are running."""
    def end(number: int, frame: FrameType | None) -> None:
        # Nothing has begun, and an interrupted import would print a traceback.
        say(f'{name}: interrupted')
        os._exit(INTERRUPTED)

    _answer_signals(end)


def say(text: str) -> None:
    """Print a line on standard error; ignore a closed stream."""
    with suppress(OSError, ValueError):
        print(one_line(text), file=sys.stderr, flush=True)


def write_output(text: str = '') -> None:
    """Write a text to standard output, at once; raise OutputFailed if the output is full."""
    try:
        if sys.stdout is not None:
            sys.stdout.write(text)
            sys.stdout.flush()
    except BrokenPipeError:
        discard_output()
    except OSError as error:
        discard_output()
        raise OutputFailed(error) from error


def discard_output() -> None:
    """Discard further standard output, because its reader has gone or its disk is full."""
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def simplify_streams() -> None:
    """Replace characters missing in the terminal, instead of raising an exception."""
    codecs.register_error(READABLE, _readable)
    with suppress(AttributeError, OSError, ValueError):
        # A stream without this method stays as it is.
        sys.stdout.reconfigure(errors=READABLE)  # type: ignore[union-attr]


def _readable(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    missing = error.object[error.start:error.end]
    return ''.join(SIMPLER.get(character, '?') for character in missing), error.end


@contextmanager
def _signals_heard(heard: list[int], ends_process: bool) -> Iterator[None]:
    """Raise Interrupted on signals during the block, and record their numbers."""
    def hear(number: int, frame: FrameType | None) -> None:
        heard.append(number)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        raise Interrupted

    def on_unraisable(unraisable: sys.UnraisableHookArgs) -> None:
        if isinstance(unraisable.exc_value, Interrupted):
            # It arrived within a callback, which cannot pass it on. One alarm alone may come just before a call
            # that waits, which would then wait on.
            signal.setitimer(signal.ITIMER_REAL, AGAIN_S, AGAIN_S)
        else:
            hook_before(unraisable)

    before, hook_before = _answer_signals(hear), sys.unraisablehook
    sys.unraisablehook = on_unraisable
    try:
        yield
    finally:
        # The rest takes no time, and needs no second message about an interruption.
        _answer_signals(signal.SIG_IGN)
        sys.unraisablehook = hook_before
        if not ends_process:
            for number, handler in before.items():
                signal.signal(number, handler)


def _answer_signals(handler: Handler) -> dict[int, Handler]:
    """Set the handler of all signals that end a program; return the previous ones."""
    try:
        return {number: signal.signal(number, handler) for number in SIGNALS}
    except ValueError:
        # Only the main thread gets signals.
        return {}


def _say(name: str, error: BaseException) -> int:
    """Print the cause of the end, and return the exit status; re-raise unexpected errors."""
    if isinstance(error, ModuleNotFoundError) and (module := (error.name or '').partition('.')[0]) in PACKAGES:
        error = MissingPackage(advice(module))
    if isinstance(error, (InvalidInput, PlanningFailure)):
        for problem in error.problems if isinstance(error, InvalidInput) else [error]:
            say(f'{name}: error: {problem}')
        return REFUSED
    if isinstance(error, (OutputFailed, WorkerLost)):
        say(f'{name}: error: {error} {getattr(error, "kept", "")}'.rstrip())
        return FAILED
    raise error


class InterruptedEnding:
    """End of a study's work; `cause` is None if the study is complete."""

    cause: Interrupted | WorkerLost | None = None

    @property
    def is_complete(self) -> bool:
        """Whether the work ended without interruption."""
        return self.cause is None

    def tell(self, finished: int | str, wanted: int | str, what: str,
             files: Iterable[AnyPath | None], results: AnyPath | None = None) -> None:
        """
        Raise the cause, if any, after the finished results have been saved.

        The message says that `finished` of `wanted` `what` (a plural such as 'trips') are finished, and
        which of `files` (None: not requested) hold them; the study can continue from a file of `results`.
        """
        if self.cause is None:
            return
        names = ['standard output' if path == STANDARD_OUTPUT else str(path)
                 for path in files if path is not None]
        if not finished:
            kept = ('nothing finished, nothing written' if results is None
                    else 'no results yet')
        elif names:
            kept = f'finished results are in {" and ".join(names)}'
        else:
            kept = 'the summary covers finished results only'
        if results is not None:
            kept += f'; the same command continues from {results}'
        self.cause.kept = f'after {finished} of {wanted} {what}; {kept}'
        raise self.cause


@contextmanager
def keeping_what_is_finished() -> Iterator[InterruptedEnding]:
    """Yield an InterruptedEnding; an interruption ends the block, and can be raised later by `tell`."""
    ending = InterruptedEnding()
    try:
        yield ending
    except (Interrupted, WorkerLost) as cause:
        ending.cause = cause
