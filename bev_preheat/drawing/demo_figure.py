# SPDX-License-Identifier: Apache-2.0
"""Draws a drive: temperature, heater command and state of charge over time."""

from __future__ import annotations

from typing import Protocol, TYPE_CHECKING

import numpy as np

from bev_preheat.control.settings import Settings
from bev_preheat.drawing.curves import draw_course, draw_steps, show_range, TimeAxis
from bev_preheat.drawing.figure import legend_above, save_figure, stacked_figure
from bev_preheat.drawing.palette import AMBIENT, look_of, PREDICTION, TARGET, WITHOUT_PREHEATING
from bev_preheat.messages.route_plan import mission_from_message
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.planner import plan_unheated
from bev_preheat.planning.situation import BatteryState

if TYPE_CHECKING:

    from matplotlib.figure import Figure

    from bev_preheat.drawing.palette import Style
    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.planning.plan import Plan
    from bev_preheat.vehicle import Vehicle
    from bev_preheat_msgs.msg import RoutePlan


class DrawnDrive(Protocol):
    """Data of a drive for drawing; a demonstration's `ObservedDrive` describes each."""

    @property
    def route(self) -> RoutePlan:
        """RoutePlan of the drive."""

    @property
    def states(self) -> list[tuple[float, float, float]]:
        """(Instant [s], temperature [deg C], state of charge)."""

    @property
    def commands(self) -> list[tuple[float, float]]:
        """(Instant [s], power [W])."""

    @property
    def predictions(self) -> list[tuple[float, float]]:
        """(Instant [s], arrival temperature [deg C])."""

    @property
    def start_ns(self) -> int:
        """Instant at which the route starts [ns]."""

    @property
    def duration_s(self) -> float:
        """Duration of the route [s]."""

    @property
    def target_c(self) -> float:
        """Target battery temperature on arrival [deg C]."""


def draw_drive(path: AnyPath, drive: DrawnDrive, vehicle: Vehicle, title: str) -> None:
    """Draw an `ObservedDrive` into a file; its suffix gives the format."""
    save_figure(make_drive_figure(drive, vehicle, title), path)


def make_drive_figure(drive: DrawnDrive, vehicle: Vehicle, title: str) -> Figure:
    """Return the figure of an `ObservedDrive`, over the unheated drive."""
    figure, (temperature, heater, charge) = stacked_figure(3, title, panel_height_in=2.3)
    time = TimeAxis(drive.duration_s)
    instants_s, temperatures_c, socs = np.array(drive.states).T
    unheated, unheated_from_s = _unheated(drive, vehicle)
    planner, idle = look_of('planner'), look_of(WITHOUT_PREHEATING)

    def line(label: str) -> Style:
        return planner.line(linewidth=1.6, label=label)

    draw_course(temperature, time(instants_s), temperatures_c,
                **line(f'battery, arrival at {temperatures_c[-1]:.1f} °C'))
    draw_course(temperature, time(unheated_from_s + unheated.time_s),
                unheated.battery_temperature_c, **idle.line(
                    label=f'{WITHOUT_PREHEATING}, at {unheated.arrival_temperature_c:.1f} °C'))
    if drive.predictions:
        prediction_s, predicted_c = np.array(drive.predictions).T
        draw_course(temperature, time(prediction_s), predicted_c, color=PREDICTION,
                    linewidth=1.2, label='predicted arrival temperature')
    temperature.axhline(drive.target_c, **TARGET, label=f'target {drive.target_c:.1f} °C')
    edges_s = np.concatenate(([0.0], np.cumsum(drive.route.segment_duration)))
    draw_steps(temperature, time(edges_s),
               np.broadcast_to(drive.route.ambient_temperature, len(edges_s) - 1), **AMBIENT)
    show_range(temperature, *(curve.get_ydata() for curve in temperature.get_lines()), least=5.0)
    temperature.set_ylabel('temperature\n[°C]')

    command_s, power_w = np.array(drive.commands).T
    on_s = command_s[power_w > 0.0]
    # The last command holds until the vehicle stands.
    draw_steps(heater, time([*command_s, max(command_s[-1], instants_s[-1])]), power_w / 1e3,
               **line(f'command, on after {duration_text(on_s[0])}' if len(on_s) else 'command, never on'))
    show_range(heater, [0.0], *(curve.get_ydata() for curve in heater.get_lines()), least=1.0)
    heater.set_ylabel('heater power\nfor the battery [kW]')

    draw_course(charge, time(instants_s), 100.0 * socs,
                **line(f'battery, arrival with {100.0 * socs[-1]:.1f} %'))
    draw_course(charge, time(unheated_from_s + unheated.time_s), 100.0 * unheated.soc, **idle.line(
        label=f'{WITHOUT_PREHEATING}, with {100.0 * unheated.arrival_soc:.1f} %'))
    show_range(charge, *(curve.get_ydata() for curve in charge.get_lines()), least=5.0)
    charge.set_ylabel('state of charge\n[%]')
    time.finish(charge, 0.0, drive.duration_s)
    for axis in (temperature, heater, charge):
        legend_above(axis)
    figure.align_ylabels()
    return figure


def _unheated(drive: DrawnDrive, vehicle: Vehicle) -> tuple[Plan, float]:
    """Return the Plan of the same drive without preheating, and the instant [s] of its start."""
    leg, = mission_from_message(drive.route, vehicle.defaults, Settings.planning_step_s, vehicle).legs
    instant_s, temperature_c, soc = drive.states[0]
    from_s = max(instant_s, 0.0)
    route = leg.route_ahead(leg.start_ns + round(from_s * NS_PER_S))
    if route is None:
        raise ValueError('the drive begins after the end of its route')
    return plan_unheated(vehicle, route, BatteryState(temperature_c, soc),
                         leg.goal(drive.target_c)), from_s
