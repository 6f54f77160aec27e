# SPDX-License-Identifier: Apache-2.0
"""
Local times of a time zone as instants [ns], and back.

Rules for clock changes are those of RFC 5545 (section 3.3.5): a local time that occurs twice means the first
occurrence; a skipped one is read with the offset before the gap, so 02:30 becomes 03:30. A time with its own
offset names its instant, whatever the zone.
"""

from __future__ import annotations

from datetime import date, datetime, time, timedelta, tzinfo, UTC
import re
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.numerics.factors import NS_PER_S

CLOCK = re.compile(r'([01]?\d|2[0-3]):([0-5]\d)')
DATED = re.compile(r'(\d{4})-(\d\d)-(\d\d)[ T]([01]?\d|2[0-3]):([0-5]\d)(?::([0-5]\d)(?:\.0+)?)?'
                   r'(?: ?(?:(Z)|([+-])([01]\d|2[0-3]):?([0-5]\d)))?')
DAYS = ('monday', 'tuesday', 'wednesday', 'thursday', 'friday', 'saturday', 'sunday')
# The names in the database are shorter.
LONGEST_ZONE_NAME = 100
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def zone_of(name: str) -> tzinfo:
    """Return the time zone of an IANA name; raise InvalidInput if it is unknown on this computer."""
    if name == 'UTC':
        return UTC
    try:
        if len(name) > LONGEST_ZONE_NAME:
            raise ValueError
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError) as error:
        raise InvalidInput(
            f'time_zone: {quoted(name)} is unknown on this computer; it must be a name of the IANA time zone '
            'database, such as Europe/Berlin or UTC (Debian package tzdata)') from error


def clock_time(text: str) -> time:
    """Return the time of day of a text HH:MM; raise InvalidInput."""
    match = CLOCK.fullmatch(text)
    if match is None:
        raise InvalidInput(f'{quoted(text)} is not allowed; it must be HH:MM, 0:00 ... 23:59')
    return time(int(match[1]), int(match[2]))


def dated_instant_ns(text: str, zone: tzinfo) -> int:
    """
    Return the instant [ns] of a text YYYY-MM-DD HH:MM in a zone, or with its own offset; raise InvalidInput.

    The offset (Z, +01:00) tells apart the two hours of the same name when clocks are set back.
    """
    match = DATED.fullmatch(text)
    try:
        if match is None:
            raise ValueError
        *numbers, utc, sign, hours, minutes = match.groups(default='')
        moment = datetime(*(int(number or 0) for number in numbers))  # type: ignore[arg-type]
        if utc or sign:
            offset = timedelta(hours=int(hours or 0), minutes=int(minutes or 0))
            return _ns_of(moment.replace(tzinfo=UTC) - (-offset if sign == '-' else offset))
    except (ValueError, OverflowError) as error:
        raise InvalidInput(f'{quoted(text)} is not allowed; it must be YYYY-MM-DD HH:MM, if need be with an '
                           'offset: YYYY-MM-DD HH:MM+01:00') from error
    return instant_ns(moment.date(), moment.time(), zone)


def instant_ns(day: date, clock: time, zone: tzinfo) -> int:
    """Return the instant [ns] at which the clocks of a zone show a time on a day."""
    # fold=0 follows RFC 5545 for both kinds of clock change.
    return _ns_of(datetime.combine(day, clock.replace(fold=0), zone))


def _ns_of(moment: datetime) -> int:
    elapsed = moment - EPOCH
    return (elapsed.days * 86400 + elapsed.seconds) * NS_PER_S


def local(instant: int, zone: tzinfo) -> datetime:
    """Return the local date and time of an instant [ns], in whole seconds."""
    return (EPOCH + timedelta(seconds=instant // NS_PER_S)).astimezone(zone)


def in_words(instant: int, zone: tzinfo) -> str:
    """Return an instant [ns] as weekday, date, local time and zone: Thu 2026-11-26 07:30 CET."""
    moment = local(instant, zone)
    # strftime's %a depends on the locale.
    return f'{DAYS[moment.weekday()][:3].capitalize()} {moment:%Y-%m-%d %H:%M} {moment.tzname()}'
