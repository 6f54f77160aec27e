# SPDX-License-Identifier: Apache-2.0
"""The reference car with heat sources of a vehicle file, and a plant of the tests' own for their plans."""

from dataclasses import replace

from own_plant import OwnPlant, table
import pytest
import yaml

from bev_preheat.files.input_files import find_configuration
from bev_preheat.planning.situation import BatteryState
from bev_preheat.vehicle.loading import load_vehicle, vehicle_of_text

REFERENCE = yaml.safe_load(find_configuration('vehicles', 'reference', '.yaml').read_text(encoding='utf-8'))
ALONE = load_vehicle('reference')


def vehicle_with(sources, **changes):
    contents = {**REFERENCE, **changes, 'heat_sources': sources}
    return vehicle_of_text(yaml.safe_dump(contents, sort_keys=False), 'the file')


def as_curve(value):
    """Return f(ambient_c, temperature_c) of a number or a table, by the tests' own interpolation."""
    if not isinstance(value, dict):
        return lambda ambient_c, temperature_c: value
    return table({('soc' if name == 'ambient_c' else name): axis for name, axis in value.items()})


def heat_of(plan, route, sources):
    """Return the heat of a plan's electrical powers [W] (N,), as the file describes the sources."""
    heat_w = REFERENCE['hvch']['efficiency'] * plan.source_power_w['hvch']
    for name, source in sources.items():
        heat_w = heat_w + plan.source_power_w[name] * [
            as_curve(source['heat_per_watt'])(*at) for at in zip(
                route.ambient_temperature_c.tolist(), plan.battery_temperature_c[:-1].tolist())]
    return heat_w


def driven(plan, route, sources, soc, brake_w=None):
    """Return the Driven of a plan, whose energies must be those of the sources."""
    heat_w, drawn_w = heat_of(plan, route, sources), sum(plan.source_power_w.values())
    assert plan.energy_wh.hvch_heat == pytest.approx(heat_w @ route.duration_s / 3600.0, rel=1e-6)
    assert plan.energy_wh.hvch_electric == pytest.approx(drawn_w @ route.duration_s / 3600.0)
    as_hvch_w = heat_w / REFERENCE['hvch']['efficiency']
    # The power of the sources beyond that of an HVCH with the same heat.
    route = replace(route, auxiliary_power_w=route.auxiliary_power_w + drawn_w - as_hvch_w)
    return OwnPlant('reference').drive(
        route, BatteryState(float(plan.battery_temperature_c[0]), soc), as_hvch_w, brake_w)
