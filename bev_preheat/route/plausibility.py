# SPDX-License-Identifier: Apache-2.0
"""Warnings about values of a route that are valid but implausible for usual cars, as if in a wrong unit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from bev_preheat.errors import figure
from bev_preheat.route.segments import Route
from bev_preheat.vehicle.description import Vehicle

# Highest auxiliary power [W] and ambient temperature [deg C] of usual cars.
MOST_AUXILIARY_W = 6e3
HOTTEST_USUAL_AMBIENT_C = 50.0
# Power above its maximum by this factor is no rounding, rough data sheet or excessive cabin request.
MOST_BEYOND_MAXIMUM = 1.5
# Half of the air's density times the least drag area of a car [kg/m]; 1.2 kg/m^3 and 0.4 m^2.
LEAST_DRAG_KG_PER_M = 0.24
# Drag above the drive's energy by this factor means a wrong power or speed; long descents may reach it, too.
MOST_DRAG = 1.5
# The check applies above this mean speed [m/s].
CHECKED_FROM_MPS = 5.0
# A mean power below this [W] at such a speed is in kilowatts.
LEAST_USUAL_POWER_W = 300.0


def unit_warnings(routes: Iterable[Route], vehicle: Vehicle, with_units: bool = False) -> list[str]:
    """Return a sentence for each field of the Routes that looks like a wrong unit, named `with_units` or not."""
    found: dict[str, str] = {}
    for route in routes:
        for field, sentence in _warnings(route, vehicle):
            name = field if with_units else field.rpartition('_')[0]
            found.setdefault(field, f'{name}: {sentence}')
    return list(found.values())


def _warnings(route: Route, vehicle: Vehicle) -> Iterator[tuple[str, str]]:
    heater_w, drive_w = vehicle.hvch.maximum_power_w, vehicle.drivetrain.maximum_power_w
    for field, most, why in (
            ('cabin_heating_power_w', heater_w, 'the heater has'),
            ('propulsion_power_w', drive_w, 'the drivetrain has'),
            ('auxiliary_power_w', MOST_AUXILIARY_W, 'usual cars take at most')):
        values = getattr(route, field)
        at = int(np.abs(values).argmax())
        # Without a heater another source warms the cabin.
        if abs(values[at]) > MOST_BEYOND_MAXIMUM * most > 0.0:
            yield (field, f'{figure(values[at])} W {_when(route, at)}; {why} {figure(most, 3)} W; check the unit')
    ambient_c = route.ambient_temperature_c
    at = int(ambient_c.argmax())
    if ambient_c[at] > HOTTEST_USUAL_AMBIENT_C:
        yield ('ambient_temperature_c', f'{figure(ambient_c[at])} degC {_when(route, at)}; '
               f'at most {HOTTEST_USUAL_AMBIENT_C:g} degC are usual; check the unit')
    yield from _drag_warnings(route)


def _when(route: Route, at: int) -> str:
    return f'at min {float(route.duration_s[:at].sum()) / 60.0:.1f}'


def _drag_warnings(route: Route) -> Iterator[tuple[str, str]]:
    """Yield the warning about a drive with less energy than the drag of the slimmest car."""
    duration_s, speed_mps = route.duration_s, route.speed_mps
    total_s = route.total_duration_s
    mean_w = float(np.maximum(route.propulsion_power_magnitude_w, 0.0) @ duration_s) / total_s
    mean_mps = float(speed_mps @ duration_s) / total_s
    drag_w = LEAST_DRAG_KG_PER_M * float(speed_mps**3 @ duration_s) / total_s
    if mean_mps < CHECKED_FROM_MPS or drag_w <= MOST_DRAG * mean_w:
        return
    sentence = (f'{{}} on average; drag alone takes {figure(drag_w, 3)} W at these speeds, and the drive has '
                f'{figure(mean_w, 3)} W; check the unit')
    if mean_w < LEAST_USUAL_POWER_W:
        yield 'propulsion_power_w', sentence.format(f'{figure(mean_w, 3)} W')
    else:
        yield 'speed_mps', sentence.format(f'{mean_mps:.1f} m/s')
