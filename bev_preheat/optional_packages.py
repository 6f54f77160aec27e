# SPDX-License-Identifier: Apache-2.0
"""
Optional Python packages, and the message about a missing one.

Code that needs one checks it here before computing anything, and then ends with one line instead of a traceback.
"""

from importlib.util import find_spec
from typing import NamedTuple

from bev_preheat.errors import InvalidInput


class OptionalPackage(NamedTuple):
    """Purpose of a package, its main group in scripts/requirements-optional.txt, its name if not the module's."""

    purpose: str
    group: str
    name: str = ''


# By the module that is imported.
PACKAGES = {
    'asammdf': OptionalPackage('reads MDF4 files', 'logs'),
    'can': OptionalPackage('reads CAN frames from buses and recordings', 'bus', 'python-can'),
    'cantools': OptionalPackage('decodes CAN signals by a DBC', 'bus'),
    'casadi': OptionalPackage('solves the nonlinear program', 'nlp'),
    'crccheck': OptionalPackage('computes the checksums of CAN frames', 'bus'),
    'jinja2': OptionalPackage('writes reports', 'identify'),
    'kuksa_client': OptionalPackage('talks to a VSS databroker', 'bus', 'kuksa-client'),
    'matplotlib': OptionalPackage('draws figures', 'demo'),
    'mcap': OptionalPackage('writes flight recordings and reads MCAP files', 'demo'),
    'pandas': OptionalPackage('holds results as tables', 'tables'),
    'psutil': OptionalPackage('measures processes', 'studies'),
    'rosbags': OptionalPackage('reads rosbag2 and MCAP files', 'logs'),
    'scipy': OptionalPackage('fits vehicles to logs and to the paper', 'identify'),
    'serial': OptionalPackage('opens the serial port of a CAN adapter', 'bus', 'pyserial'),
    'tornado': OptionalPackage('serves the web page of the dashboard', 'dashboard')}


class MissingPackage(InvalidInput):
    """An optional package is not installed; the message names it, its purpose, and the install command."""


def is_installed(module: str) -> bool:
    """Return whether a module of PACKAGES can be imported, without importing it."""
    return find_spec(module) is not None


def advice(module: str) -> str:
    """Return the sentence on a missing module of PACKAGES and its installation."""
    package = PACKAGES[module]
    name = package.name or module
    return (f'the Python package {name}, which {package.purpose}, is not installed; in the checkout, '
            f'scripts/setup.bash {package.group} installs it; elsewhere: python3 -m pip install {name}')


def require_ros() -> None:
    """Raise MissingPackage if ROS 2 cannot be imported."""
    if find_spec('rclpy') is None or find_spec('bev_preheat_msgs') is None:
        raise MissingPackage('this command needs ROS 2, which is missing; source the setup files of ROS 2 and of '
                             'the workspace that bev_preheat is built in')


def require(*modules: str) -> None:
    """Raise MissingPackage unless all these modules of PACKAGES are installed."""
    missing = [module for module in modules if not is_installed(module)]
    if missing:
        raise MissingPackage([advice(module) for module in missing])
