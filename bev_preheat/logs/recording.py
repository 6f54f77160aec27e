# SPDX-License-Identifier: Apache-2.0
"""A recorded drive in SI units: one series of samples for each signal, at the log's own instants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray


@dataclass(frozen=True)
class Series:
    """
    Samples of one signal: `time_s` (strictly increasing) and `value`, both of shape (N,), all finite.

    Times count from the start of the recording. The unit is the ending of the signal's name.
    """

    time_s: FloatArray
    value: FloatArray


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
