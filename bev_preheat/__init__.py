# SPDX-License-Identifier: Apache-2.0
"""
Battery preheating before fast charging: model, planning, command line and ROS 2 nodes.

`import bev_preheat as bp` gives the public Python interface, the names in `__all__`; everything else is internal
and may change. A name is loaded when it is first used, to keep the nodes small.
"""

from importlib import import_module
from importlib.util import find_spec
import os
from typing import Any, TYPE_CHECKING

# Set before NumPy loads. No matrix here has more than about ten rows, and OpenBLAS would start a
# thread per core: a quarter of the planner's start-up time.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

__all__ = [
    'BatteryState', 'CheckResult', 'ComparisonResult', 'DriveResult', 'Goal', 'HeaterFault',
    'IdentificationResult', 'InvalidInput', 'MethodSituation', 'Mismatch', 'OptimumResult', 'PlanResult',
    'PlanningFailure', 'Prediction', 'Recording', 'Route', 'Sensors', 'SessionResult', 'Vehicle', 'WorthResult',
    'charging_session', 'check', 'compare', 'drive', 'identify', 'load_recording', 'load_route', 'load_vehicle',
    'make_route', 'make_vehicle', 'methods', 'optimum', 'plan', 'routes', 'vehicles', 'worth']
# The studies are a package of their own, which may be left out.
_OF_STUDIES = ('ReproductionResult', 'RobustnessResult', 'SweepResult', 'reproduce', 'robustness', 'sweep')
if find_spec('bev_preheat_studies') is not None:
    __all__.extend(_OF_STUDIES)

if TYPE_CHECKING:
    from bev_preheat.errors import InvalidInput, PlanningFailure
    from bev_preheat.interface.drive_results import (
        CheckResult,
        DriveResult,
        IdentificationResult,
        SessionResult,
        WorthResult,
    )
    from bev_preheat.interface.functions import (
        charging_session,
        check,
        compare,
        drive,
        identify,
        methods,
        optimum,
        plan,
        worth,
    )
    from bev_preheat.interface.inputs import (
        load_recording,
        load_route,
        load_vehicle,
        make_route,
        make_vehicle,
        routes,
        vehicles,
    )
    from bev_preheat.interface.results import ComparisonResult, OptimumResult, PlanResult
    from bev_preheat.logs.recording import Recording
    from bev_preheat.planning.installed_methods import MethodSituation, Prediction
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.route import Route
    from bev_preheat.simulation.heater import HeaterFault
    from bev_preheat.simulation.imperfect_car import Mismatch
    from bev_preheat.simulation.sensors import Sensors
    from bev_preheat.vehicle import Vehicle
    reproduce: Any
    robustness: Any
    sweep: Any
    ReproductionResult: Any
    RobustnessResult: Any
    SweepResult: Any
else:
    _MODULES = {
        **dict.fromkeys(('InvalidInput', 'PlanningFailure'), 'errors'),
        **dict.fromkeys(('charging_session', 'check', 'compare', 'drive', 'identify', 'methods', 'optimum', 'plan',
                         'worth'), 'interface.functions'),
        **dict.fromkeys(('load_recording', 'load_route', 'load_vehicle', 'make_route', 'make_vehicle', 'routes',
                         'vehicles'), 'interface.inputs'),
        **dict.fromkeys(('ComparisonResult', 'OptimumResult', 'PlanResult'), 'interface.results'),
        **dict.fromkeys(('CheckResult', 'DriveResult', 'IdentificationResult', 'SessionResult', 'WorthResult'),
                        'interface.drive_results'),
        **dict.fromkeys(('BatteryState', 'Goal'), 'planning.situation'),
        **dict.fromkeys(('MethodSituation', 'Prediction'), 'planning.installed_methods'),
        'Recording': 'logs.recording', 'Route': 'route', 'HeaterFault': 'simulation.heater',
        'Mismatch': 'simulation.imperfect_car', 'Sensors': 'simulation.sensors', 'Vehicle': 'vehicle'}

    def __getattr__(name: str) -> Any:
        """Return a name of `__all__` out of its module."""
        if name in _OF_STUDIES and name in __all__:
            return getattr(import_module('bev_preheat_studies.interface'), name)
        if name not in _MODULES:
            raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
        return getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)
