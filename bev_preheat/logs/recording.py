# SPDX-License-Identifier: Apache-2.0
"""A recorded drive in SI units: one series of samples for each signal, at the log's own instants, and its gaps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from bev_preheat.numerics import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Series:
    """
    Samples of one signal: `time_s` (strictly increasing) and `value`, both of shape (N,), all finite.

    Times count from the start of the recording. The unit is the ending of the signal's name.
    """

    time_s: FloatArray
    value: FloatArray

    def at(self, time_s: FloatArray, beyond: float | None = None) -> FloatArray:
        """Return the values at instants, linear between samples; outside `beyond`, None: the first or last."""
        return np.interp(time_s, self.time_s, self.value, beyond, beyond)

    def part(self, chosen: BoolArray | IntArray) -> Series:
        """Return the chosen samples."""
        return Series(self.time_s[chosen], self.value[chosen])


@dataclass(frozen=True)
class Recording:
    """
    A recorded drive, charging session or night.

    `signals` maps names of SIGNALS to their Series; a signal that was not recorded is absent. `start_s` is the
    start in seconds since the epoch, None if the log has relative times only. `signal_map` names the signal map
    that was used. `remarks` are sentences on doubts and on everything that was dropped or bridged, one a cause.
    `format` is the file's format; `sources` has the channels that a signal was read from, with their units;
    `unused` names the other channels of the log.
    """

    name: str
    signals: Mapping[str, Series]
    start_s: float | None = None
    signal_map: str = ''
    remarks: tuple[str, ...] = ()
    format: str = ''
    sources: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    unused: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f'<Recording {self.name}: {self.duration_s / 60.0:.1f} min; {", ".join(self.signals)}>'

    @property
    def duration_s(self) -> float:
        """Time from the first sample of any signal to the last [s]."""
        return max(float(series.time_s[-1]) for series in self.signals.values())


# Every signal that a recording may have; the ending is the unit. `current_a` and `power_w` (the battery's terminal
# power) are positive while it is discharged. `power_w` holds everything that the battery delivers.
SIGNALS = (
    'battery_temperature_c', 'soc', 'voltage_v', 'current_a', 'power_w', 'speed_mps', 'elevation_m', 'ambient_c',
    # Electrical power of the coolant heater for battery and cabin together, if not known separately.
    'heater_w', 'battery_heater_w', 'cabin_heater_w',
    # All auxiliaries; the air conditioning alone.
    'auxiliary_w', 'aircon_w', 'propulsion_power_w', 'coolant_c', 'latitude_deg',
    'longitude_deg', 'odometer_m')


# An interval is a gap if it is this many times the usual one, and longer than LEAST_GAP_S. In a log whose
# intervals mostly are the same, a single missing sample is a gap.
GAP_TIMES, REGULAR_GAP_TIMES, LEAST_GAP_S = 2.5, 1.9, 1.5
REGULAR_SHARE, REGULAR_DEVIATION = 0.6, 0.05


@dataclass(frozen=True)
class Sampling:
    """Usual interval of the samples [s] (NaN: fewer than two); number of gaps; the longest [s]."""

    interval_s: float
    gaps: int
    longest_gap_s: float


def gaps(series: Series) -> BoolArray:
    """Return which intervals between samples are gaps, shape (N - 1,)."""
    steps_s = np.diff(series.time_s)
    if not len(steps_s):
        return np.zeros(0, dtype=bool)
    usual_s = float(np.median(steps_s))
    regular = np.mean(np.abs(steps_s - usual_s) <= REGULAR_DEVIATION * usual_s) >= REGULAR_SHARE
    return np.asarray(steps_s > max(LEAST_GAP_S, (REGULAR_GAP_TIMES if regular else GAP_TIMES) * usual_s))


def sampling(series: Series) -> Sampling:
    """Return the Sampling of a signal."""
    if len(series.time_s) < 2:
        return Sampling(np.nan, 0, 0.0)
    steps_s, gap = np.diff(series.time_s), gaps(series)
    return Sampling(float(np.median(steps_s)), int(gap.sum()), float(steps_s.max()) if gap.any() else 0.0)
