# SPDX-License-Identifier: Apache-2.0
"""
The library of the package bev_preheat_core: found, loaded on first use, switched off, and its declined calls.

`planning.engine` has the same in pure Python, for use without the library, with the library switched off, and
if the library declines a call; declined calls are counted by function and reason. The header core.h documents the
functions.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from ctypes import c_int32, CDLL
from functools import lru_cache, wraps
import os
import re
from typing import Any, ParamSpec, TypeVar

from bev_preheat.vehicle import core_structs
from bev_preheat.vehicle.core_interface import constants, fields_of, Interface, TYPES

OK, SATURATED, EMPTY, NO_CROSSING, LIMITED, CHEAPER_ELSEWHERE, LEFT = range(7)
# Values of bev_status, then their names in the counter.
REASONS = {
    SATURATED: 'the battery is short of power', EMPTY: 'the charge runs out', NO_CROSSING: 'no crossing',
    LIMITED: 'a limit is active', CHEAPER_ELSEWHERE: 'heating elsewhere may cost less', -1: 'bad argument',
    -2: 'bad vehicle', -3: 'bad input', -4: 'no finite number', -5: 'search not settled'}
# Statuses besides OK that are answers: the caller uses the core's result.
ANSWERS = {
    'bev_run': {SATURATED}, 'bev_run_heated': {SATURATED}, 'bev_plan_by_values': {EMPTY},
    'bev_follow_values': {EMPTY, LEFT}}
_NONE: set[int] = set()
P = ParamSpec('P')
R = TypeVar('R')


# How often each function declined in this process, and why.
DECLINES: Counter[tuple[str, str]] = Counter()


def _note(status: int, function: Any, arguments: Any) -> int:
    """Count the status of a call unless it is an answer, and return it: an `errcheck` of ctypes."""
    if status != OK and status not in ANSWERS.get(function.__name__, _NONE):
        DECLINES[function.__name__, REASONS.get(status, str(status))] += 1
    return status


def declines_in_words() -> str:
    """Return how many calls were declined, and, if some were, by function and reason; the most frequent first."""
    each = ', '.join(f'{count} x {name} ({reason})' for (name, reason), count in DECLINES.most_common())
    return f'{DECLINES.total()}: {each}' if each else '0'


class Declined(Exception):
    """The core is not used, or does not answer: Python is to."""


FILE = 'libbev_preheat_core.so'
# BEV_INTERFACE of core.h.
INTERFACE = 13

# Arguments by the letters of core_interface: P an address, D a double, I an integer.
_SIGNATURES = {
    'bev_check_vehicle': 'P',
    'bev_make_trip': 'PIPP',
    'bev_run': 'PIPIPPPP',
    'bev_run_heated': 'PPPPP',
    'bev_limits_of_steps': 'PIPPPPP',
    'bev_drive_as_planned': 'PPPDIPPPP',
    'bev_keep_accounts': 'PIPPPP',
    'bev_plan_switch': 'PPDDDIPPPPP',
    'bev_follow': 'PPPPP',
    'bev_take_reading': 'PPPPPP',
    'bev_arrival_variance': 'PPPPP',
    'bev_find_two_switches': 'PPDPPPPPPP',
    'bev_plan_by_values': 'PPPPPPPPI',
    'bev_follow_values': 'PPPIPPPPP',
}


class _Switch:
    """Whether the process uses the library if it is available."""

    is_on = True
    is_held_off = False


def use_core(is_on: bool) -> None:
    """Switch the use of the library in this process on or off."""
    _Switch.is_on = is_on


@contextmanager
def without_core() -> Iterator[None]:
    """Use Python alone within the context, in the whole process: the reference for the core."""
    before, _Switch.is_held_off = _Switch.is_held_off, True
    try:
        yield
    finally:
        _Switch.is_held_off = before


def core() -> Any:
    """Return the library, None if it is not available or switched off."""
    return loaded_core()[0] if _Switch.is_on and not _Switch.is_held_off else None


def call(name: str, *arguments: Any) -> int:
    """Call a function of the library and return its status: OK, or one in ANSWERS; raises Declined otherwise."""
    library = core()
    if library is None:
        raise Declined
    status: int = getattr(library, name)(*arguments)
    if status != OK and status not in ANSWERS.get(name, _NONE):
        raise Declined
    return status


def operation(in_core: Callable[P, R], in_python: Callable[P, R]) -> Callable[P, R]:
    """Return the function that is the core's if it answers, else Python's; it has the name of Python's."""
    @wraps(in_python)
    def either(*arguments: P.args, **named: P.kwargs) -> R:
        try:
            return in_core(*arguments, **named)
        except Declined:
            return in_python(*arguments, **named)
    return either


def core_in_words() -> str:
    """Return whether the library is used, and why not."""
    if not _Switch.is_on or _Switch.is_held_off:
        return 'not used: switched off'
    library, problem = loaded_core()
    return f'used: {library._name}' if library is not None else f'not used: {problem}'


@lru_cache(maxsize=1)
def loaded_core() -> tuple[Any, str]:
    """Return (library, ''), or None and the reason."""
    for prefix in filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)):
        path = os.path.join(prefix, 'lib', FILE)
        if os.path.isfile(path):
            return load_core(path)
    # Installed by pip it lies beside this file.
    path = os.path.join(os.path.dirname(__file__), FILE)
    if os.path.isfile(path):
        return load_core(path)
    return None, 'package bev_preheat_core is not built'


def load_core(path: str) -> tuple[Any, str]:
    """Return (library of that file, ''), or None and the reason."""
    try:
        library = CDLL(path)
        if library.bev_interface() != bindings().digest(constants()):
            return None, f'{path} is of another version'
        for name, types in _SIGNATURES.items():
            function = getattr(library, name)
            function.argtypes = [TYPES[each] for each in types]
            function.restype = c_int32
            function.errcheck = _note
    except (OSError, AttributeError) as error:
        return None, f'{path} cannot be loaded: {error}'
    return library, ''


def bindings() -> Interface:
    """Return the Interface that these bindings are written for."""
    # BeliefTermsStruct is bev_belief_terms in C.
    names = {struct: 'bev' + re.sub('[A-Z]', lambda letter: f'_{letter[0].lower()}', name.removesuffix('Struct'))
             for name, struct in vars(core_structs).items() if name.endswith('Struct')}
    return Interface(INTERFACE, {name: fields_of(struct, names) for struct, name in names.items()},
                     _SIGNATURES, core_structs.ROOMS)
