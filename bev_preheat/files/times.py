# SPDX-License-Identifier: Apache-2.0
"""Times as logs write them: seconds or milliseconds, relative or since the epoch, dates, times of day."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime, UTC
from functools import partial
import re
from typing import NamedTuple

import numpy as np

from bev_preheat.files.units import conversion, read_numbers
from bev_preheat.numerics import FloatArray

# Seconds since the epoch lie in these years; the same range reveals milliseconds and finer units.
EARLIEST_S, LATEST_S = 631152000.0, 4102444800.0
# A unit and the epoch's place [s]; .NET and Windows count 100 ns from the years 1 and 1601.
EPOCHS = ((1.0, 0.0), (1e-3, 0.0), (1e-6, 0.0), (1e-7, 62135596800.0), (1e-9, 0.0), (1e-7, 11644473600.0))
# Spreadsheets count days from 1899-12-30 or midnight, MATLAB from the year 0; in seconds, such steps were below a
# millisecond.
EPOCHS_DAYS, COVERED_DAYS, LARGEST_STEP_DAYS = (25569.0, 719529.0), 47481.0, 7e-4
# A log that begins earlier, at about 0, may count hours.
EARLIEST_DAYS = 0.02
# Without a unit, relative times with such steps count milliseconds, or whole minutes up to a quarter of an hour;
# finer units if the steps would be longer.
LEAST_STEP_MS, LARGEST_STEP_S = 100.0, 900.0
FINER = ((1e-3, 'milliseconds'), (1e-6, 'microseconds'), (1e-9, 'nanoseconds'))
DAY_S = 86400.0
# Years of logs whose samples are minutes apart, and the values of a counter of 32 bits.
RECENT_S, COUNTER = (1.0e9, 2.2e9), 2.0**32
TIME_UNITS = ('second', 'millisecond', 'microsecond', 'nanosecond', 'minute', 'hour')
MONTHS = ('jan', 'feb', 'mar', 'apr', 'may', 'jun', 'jul', 'aug', 'sep', 'oct', 'nov', 'dec')
OTHER_MONTHS = {'mai': 5, 'okt': 10, 'dez': 12, 'mär': 3, 'mrz': 3}
DATE_TIME = re.compile(
    r'(\d{1,4})([./ -])(\d{1,2}|[^\W\d]{3,})\.?\2(\d{2,4})[ T,]+(\d{1,2})[:.](\d{2})'
    r'(?:[:.](\d{2})(?:[.,:](\d+))?)?\s*([AaPp]\.?[Mm]\.?)?(?:\s*(Z|UTC|GMT))?')
DATE_DIGITS = re.compile(r'((?:19|20)\d{6})(\d{6})(?:\.?(\d{3}))?')
DAY_DIGITS = re.compile(r'([01]?\d|2[0-3])([0-5]\d)([0-5]\d)(\.\d+)?')
TIME_OF_DAY = re.compile(r'(\d{1,2}):(\d{2})(?::(\d{2}))?(?:(?:[.,]|(?<=:\d\d:\d\d):)(\d+))?'
                         r'\s*([AaPp]\.?[Mm]\.?)?')


class Clock(NamedTuple):
    """
    Reads the times of a log, `absolute` if from the epoch; `remark` is a sentence on an assumption, or ''.

    `seconds(texts)` returns the times [s] of cells, shape (N,); NaN for cells without a time.
    """

    seconds: Callable[[Sequence[str]], FloatArray]
    absolute: bool
    remark: str = ''


def find_clock(texts: Sequence[str], unit: str = '', decimal: str = '.') -> Clock | None:
    """Return the Clock that reads a log's first times with the header's unit ('': unknown); else None."""
    texts = [text for text in texts if text.strip()]
    if not texts:
        return None
    numbers = read_numbers(texts, decimal)[0]
    if np.mean(np.isfinite(numbers)) > 0.9 and (unit or not _are_digits_of_clocks(texts, numbers)):
        return _number_clock(numbers[np.isfinite(numbers)], unit, decimal)
    for read, rounds in ((iso_seconds, None), (_time_of_day_s, Rounds(DAY_S, 0.5 * DAY_S))):
        if np.mean(np.isfinite([read(text) for text in texts])) > 0.5:
            digits = next((text for text in texts if rounds is not None and DAY_DIGITS.fullmatch(text)), '')
            return Clock(partial(_each, read, rounds), rounds is None,
                         f'times such as {digits} are taken as times of day' if digits else '')
    return _date_clock(texts)


def _each(read: Callable[[str], float], rounds: Rounds | None, cells: Sequence[str]) -> FloatArray:
    seconds = np.array(list(map(read, cells)), dtype=float)
    return seconds if rounds is None else rounds.continued(seconds)


def _are_digits_of_clocks(texts: Sequence[str], numbers: FloatArray) -> bool:
    """Return whether numbers are 20260131080000, or 080000 and as times of day in steadier steps."""
    if all(map(DATE_DIGITS.fullmatch, texts)):
        return True
    return len(texts) > 2 and all(map(DAY_DIGITS.fullmatch, texts)) and bool(
        np.ptp(np.diff([_time_of_day_s(text) for text in texts])) < np.ptp(np.diff(numbers)))


def _number_clock(numbers: FloatArray, unit: str, decimal: str) -> Clock | None:
    scale = conversion(unit, 's').factor if unit in TIME_UNITS else None
    absolute, zero_s, remark = False, 0.0, ''
    middle = float(np.median(numbers))
    steps = np.diff(numbers)
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    for each, start_s in EPOCHS if scale is None else [(scale, 0.0)]:
        # Milliseconds since a control unit was started look like a time in seconds after some days.
        if each == 1.0 and scale is None and step >= LEAST_STEP_MS and not RECENT_S[0] <= middle <= RECENT_S[1]:
            continue
        if EARLIEST_S <= middle * each - start_s <= LATEST_S:
            scale, zero_s, absolute = each, start_s, True
            break
    epoch_days = next((each for each in EPOCHS_DAYS if each <= middle <= each + COVERED_DAYS), 0.0)
    is_in_days = scale is None and 0.0 < step < LARGEST_STEP_DAYS and (
        EARLIEST_DAYS <= numbers[0] < 1.0 or epoch_days > 0.0)
    if is_in_days:
        scale, zero_s, absolute = DAY_S, epoch_days * DAY_S, epoch_days > 0.0
        remark = 'times have no unit; they are taken as days of a spreadsheet'
    if scale is None:
        scale = 1.0
        if step >= LEAST_STEP_MS:
            is_finer = step > LARGEST_STEP_S or bool((steps % 60.0).any())
            scale, word = next((each for each in FINER if step * each[0] <= LARGEST_STEP_S), FINER[-1]) if (
                is_finer) else (1.0, 'seconds')
            remark = f'times have no unit; steps of {step:.0f} are taken as {word}'
    period_s = 0.0 if absolute else DAY_S if scale in (1.0, DAY_S) else COUNTER * scale
    rounds = Rounds(period_s) if numbers.max() * scale < period_s else None

    def read(texts: Sequence[str]) -> FloatArray:
        seconds = read_numbers(texts, decimal)[0] * scale - zero_s
        seconds = np.round(seconds, 3) if is_in_days else seconds
        return seconds if rounds is None else rounds.continued(seconds)

    return Clock(read, absolute, remark)


class Rounds:
    """Continues seconds that begin again: after midnight, or after the last value of a counter of 32 bits."""

    def __init__(self, period_s: float, fall_s: float | None = None) -> None:
        self._period_s, self._fall_s = period_s, 0.9 * period_s if fall_s is None else fall_s
        self._rounds, self._last_s = 0, np.nan

    def continued(self, seconds: FloatArray) -> FloatArray:
        """Return seconds that go on where a round ends, shape (N,)."""
        known = seconds[np.isfinite(seconds)]
        if not known.size:
            return seconds
        steps = np.diff(known, prepend=known[0] if np.isnan(self._last_s) else self._last_s)
        rounds = self._rounds + np.cumsum((steps < -self._fall_s) & (known <= self._period_s))
        self._rounds, self._last_s = int(rounds[-1]), float(known[-1])
        later = seconds.copy()
        later[np.isfinite(seconds)] = known + self._period_s * rounds
        return later


def iso_seconds(text: str) -> float:
    """Return seconds since the epoch of a time as in ISO 8601, NaN of another text; no zone means UTC."""
    text = text.strip().replace(',', '.')
    if digits := DATE_DIGITS.fullmatch(text):
        text = f'{digits[1]}T{digits[2]}.{digits[3] or "0"}'
    # datetime takes bare digits for a date.
    if len(text) < 10 or (text[4:5] != '-' and text[8:9] not in ('T', ' ')):
        return np.nan
    try:
        moment = datetime.fromisoformat(text.removesuffix(' UTC').replace('  ', ' '))
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError):
        return np.nan


def _time_of_day_s(text: str) -> float:
    """Return a time of day, or minutes and seconds, in seconds; NaN of another text."""
    # Pandas writes 0 days 00:00:05.
    days, _, text = text.strip().rpartition(' days ')
    match = TIME_OF_DAY.fullmatch(DAY_DIGITS.sub(r'\1:\2:\3\4', text) if DAY_DIGITS.fullmatch(text) else text)
    if match is None or (days and not days.isdecimal()):
        return np.nan
    if match[3] is None:
        seconds = 60.0 * int(match[1]) + int(match[2])
    else:
        seconds = 3600.0 * _hour(match[1], match[5]) + 60.0 * int(match[2]) + int(match[3])
    return seconds + (float(f'0.{match[4]}') if match[4] else 0.0) + DAY_S * int(days or 0)


def _hour(text: str, half: str | None) -> int:
    return int(text) % 12 + 12 * (half[0] in 'pP') if half else int(text)


def _date_clock(texts: Sequence[str]) -> Clock | None:
    matches = [match for match in map(DATE_TIME.fullmatch, map(str.strip, texts)) if match]
    if 2 * len(matches) <= len(texts):
        return None
    first, mark = matches[0], matches[0][2]
    remark = ''
    if len(first[1]) == 4:
        order = 'ymd'
    elif not first[3].isdigit() or any(int(match[1]) > 12 for match in matches):
        order = 'dmy'
    elif any(match[3].isdigit() and int(match[3]) > 12 for match in matches):
        order = 'mdy'
    else:
        order = 'mdy' if mark == '/' else 'dmy'
        if mark != '.':
            remark = (f'date {first[0]!r} can be read in two ways; the {"month" if order == "mdy" else "day"} is '
                      'taken to come first')
    return Clock(partial(_each, partial(_date_seconds, order), None), True, remark)


def _date_seconds(order: str, text: str) -> float:
    match = DATE_TIME.fullmatch(text.strip())
    if match is None:
        return np.nan
    parts = dict(zip(order, (match[1], match[3], match[4])))
    name = parts['m'].lower()[:3]
    month = int(name) if name.isdigit() else (
        MONTHS.index(name) + 1 if name in MONTHS else OTHER_MONTHS.get(name, 0))
    year = int(parts['y'])
    try:
        moment = datetime(year if year > 99 else 2000 + year, month, int(parts['d']), _hour(match[5], match[9]),
                          int(match[6]), int(match[7] or 0), tzinfo=UTC)
    except ValueError:
        return np.nan
    return moment.timestamp() + (float(f'0.{match[8]}') if match[8] else 0.0)
