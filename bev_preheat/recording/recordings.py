# SPDX-License-Identifier: Apache-2.0
"""Opens any recording: of the flight recorder, of `ros2 bag`, or a drive log with a route file."""

from __future__ import annotations

from dataclasses import replace
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rclpy.serialization import serialize_message

from bev_preheat.control.events import BATTERY_STATE, ROUTE_PLAN
from bev_preheat.control.inputs import Leg
from bev_preheat.control.settings import settings_of
from bev_preheat.errors import InvalidInput
from bev_preheat.files.input_files import beginning_of, mcap_messages, version
from bev_preheat.logs.reading import read_recording
from bev_preheat.logs.recording import Recording, Series
from bev_preheat.messages.battery_state import battery_state_message
from bev_preheat.messages.route_offer import offer_of
from bev_preheat.numerics import FloatArray, NS_PER_S
from bev_preheat.optional_packages import require
from bev_preheat.planning.status import Status
from bev_preheat.recording.bag import is_bag, read_topics, SQLITE, TYPES, with_repeats
from bev_preheat.recording.changes import Changes
from bev_preheat.recording.course import LEAST_HEAT_W
from bev_preheat.recording.flight import Flight, Given, LOG, read_flight
from bev_preheat.recording.records import Beginning, RecordedStep
from bev_preheat.recording.writer import BEGINNING_CHANNEL
from bev_preheat.route import route_for
from bev_preheat.vehicle import load_vehicle, vehicle_contents

# The recorder's first message is near the start of a file.
SEARCHED_RECORDS = 20
# A log without a date is put here [s since 1970].
NO_DATE_S = 1_700_000_000.0
# The planner gets at most this many battery states a second, and a signal's value for this long [s].
LEAST_STEP_S, HOLD_S = 1.0, 60.0
NEEDED = {'battery_temperature_c': 'the battery temperature', 'soc': 'the state of charge'}


class Sources(NamedTuple):
    """The inputs beside a recording: route file and signal map of a log, namespace of a ros2 bag."""

    route: str | None = None
    signals: str | None = None
    namespace: str | None = None


def has_planner(path: Path) -> bool:
    """Return whether the flight recorder wrote a recording; raises InvalidInput if it cannot be read."""
    if path.is_dir():
        return not is_bag(path)
    if not path.is_file():
        raise InvalidInput(f'{path}: does not exist; name a recording or the folder of recordings')
    if not is_bag(path) or beginning_of(path).startswith(SQLITE):
        return False
    require('mcap')
    problems: list[str] = []
    for number, message in enumerate(mcap_messages(path, problems.append)):
        if message[0] == BEGINNING_CHANNEL:
            return True
        if number > SEARCHED_RECORDS:
            break
    return False


def open_recording(path: Path, planner: Changes, sources: Sources) -> Flight:
    """Return the Flight of a recording; `planner` is for those without vehicle file; raises InvalidInput."""
    if has_planner(path):
        if sources != Sources():
            option = next(name for name, value in zip(Sources._fields, sources) if value is not None)
            raise InvalidInput(f'--{option}: a recording of the flight recorder has it already')
        return read_flight(path)
    is_topics = is_bag(path) and sources.signals is None
    if is_topics and sources.route is None:
        require('mcap')
        return read_topics(path, _beginning(planner), sources.namespace)
    if sources.namespace is not None:
        raise InvalidInput('--namespace: is for recordings of ros2 bag')
    if sources.route is None:
        raise InvalidInput(f'{path}: is no recording of the flight recorder or of ros2 bag; a log needs the route '
                           'beside it (--route)')
    return read_log(path, _beginning(planner), sources.route, sources.signals)


def _beginning(planner: Changes) -> Beginning:
    settings_of(planner.parameters)
    vehicle = planner.vehicle or 'reference'
    return Beginning(
        version(), '', '', 0, 0, False, {'vehicle': vehicle, **planner.parameters},
        vehicle_contents(vehicle).decode('utf-8', 'replace'))


def read_log(path: Path, beginning: Beginning, route: str, signals: str | None) -> Flight:
    """
    Return the Flight of a log: a battery state for each reading of the temperature, and the route of a route file.

    `beginning` has the vehicle file and the parameters of the planner, `signals` is the signal map (None: the one
    that recognises the log). The heater's power, if the log has it, stands for the recorded command. Raises
    InvalidInput, naming file and signal, if one is missing.
    """
    recording = read_recording(path, signals)
    missing = [words for name, words in NEEDED.items() if name not in recording.signals]
    if missing:
        raise InvalidInput(f'{path}: has no signal for {" and ".join(missing)}; name it in a signal map '
                           '(--signals)')
    remarks = list(recording.remarks)
    heater = next((recording.signals[name] for name in ('battery_heater_w', 'heater_w')
                   if name in recording.signals), None)
    remarks.append("the log has no commands to reproduce; the heater's recorded power stands beside the planner's "
                   'commands' if heater is not None else
                   "the log has no commands to reproduce, and no signal for the heater's power, which counts as "
                   '0 W')
    if recording.start_s is None:
        remarks.append('the log has no date; its start counts as 2023-11-14 22:13:20 UTC')
    start_ns = round((NO_DATE_S if recording.start_s is None else recording.start_s) * NS_PER_S)
    message = _route(route, beginning, start_ns)
    given = [Given(RecordedStep(start_ns, events=({'kind': ROUTE_PLAN},)),
                   (TYPES[ROUTE_PLAN], bytes(serialize_message(message))))]
    given += _battery_states(recording, heater, start_ns)
    return Flight(replace(beginning, now_ns=start_ns), tuple(with_repeats(given, beginning)), (path,),
                  remarks=tuple(remarks), source=LOG, has_commands=False)


def _route(route: str, beginning: Beginning, start_ns: int) -> Any:
    """Return the RoutePlan of a route file that starts at an instant [ns]."""
    vehicle = load_vehicle(beginning.parameters['vehicle'])
    loaded = route_for(route, vehicle)
    return offer_of(vehicle, loaded, Leg(loaded.route)).route_plan(start_ns)


def _battery_states(recording: Recording, heater: Series | None, start_ns: int) -> list[Given]:
    signals = recording.signals
    times_s = _thinned(signals['battery_temperature_c'].time_s)
    columns = {name: _held(signals.get(name), times_s) for name in (
        'battery_temperature_c', 'soc', 'voltage_v', 'current_a', 'power_w')}
    heater_w = _held(heater, times_s)
    given = []
    for index, time_s in enumerate(times_s.tolist()):
        now_ns = start_ns + round(time_s * NS_PER_S)
        value = {name: float(column[index]) for name, column in columns.items()}
        if math.isnan(value['current_a']) and value['voltage_v'] > 0.0:
            value['current_a'] = value['power_w'] / value['voltage_v']
        power_w = float(heater_w[index])
        # Holds until the next reading.
        command = None if heater is None or math.isnan(power_w) else (
            max(power_w, 0.0), now_ns + round(HOLD_S * NS_PER_S),
            int(Status.HEATING if power_w >= LEAST_HEAT_W else Status.WAITING))
        message = battery_state_message(now_ns, value['battery_temperature_c'], value['soc'], value['voltage_v'],
                                        value['current_a'])
        given.append(Given(
            RecordedStep(now_ns, events=({'kind': BATTERY_STATE},), command=command),
            (TYPES[BATTERY_STATE], bytes(serialize_message(message)))))
    return given


def _thinned(times_s: FloatArray) -> FloatArray:
    """Return times with at least LEAST_STEP_S between them."""
    kept: list[float] = []
    for time_s in times_s.tolist():
        if not kept or time_s - kept[-1] >= LEAST_STEP_S - 1e-6:
            kept.append(time_s)
    return np.array(kept)


def _held(series: Series | None, times_s: FloatArray) -> FloatArray:
    """Return the latest value of a Series at each time; NaN without one in the last HOLD_S."""
    if series is None:
        return np.full(len(times_s), math.nan)
    index = np.searchsorted(series.time_s, times_s + 1e-6, side='right') - 1
    held = np.maximum(index, 0)
    return np.where((index >= 0) & (times_s - series.time_s[held] <= HOLD_S), series.value[held], math.nan)
