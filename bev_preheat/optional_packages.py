# SPDX-License-Identifier: Apache-2.0
"""
Optional Python packages, and the message about a missing one.

Code that needs one checks it here before computing anything, and then ends with one line instead of a traceback.
"""

from importlib.util import find_spec

from bev_preheat.errors import InvalidInput

# Purpose of each module.
PURPOSES = {
    'asammdf': 'reads MDF4 files',
    'can': 'reads CAN frames from buses and recordings',
    'cantools': 'decodes CAN signals by a DBC',
    'casadi': 'solves the nonlinear program',
    'crccheck': 'computes the checksums of CAN frames',
    'jinja2': 'writes reports',
    'kuksa_client': 'talks to a VSS databroker',
    'matplotlib': 'draws figures',
    'mcap': 'writes flight recordings and reads MCAP files',
    'pandas': 'holds results as tables',
    'psutil': 'measures processes',
    'rosbags': 'reads rosbag2 and MCAP files',
    'scipy': 'fits vehicles to logs and to the paper',
    'serial': 'opens the serial port of a CAN adapter',
    'tornado': 'serves the web page of the dashboard',
}
# Distribution names that differ from the module's name.
PACKAGES = {'can': 'python-can', 'kuksa_client': 'kuksa-client',
            'serial': 'pyserial'}
# The group of packages that setup adds for a module (scripts/requirements-optional.txt); of several groups, the
# one for which the module is the main purpose.
GROUPS = {
    'asammdf': 'logs', 'can': 'bus', 'cantools': 'bus', 'casadi': 'nlp', 'crccheck': 'bus',
    'jinja2': 'identify',
    'kuksa_client': 'bus', 'matplotlib': 'demo', 'mcap': 'demo', 'pandas': 'tables',
    'psutil': 'studies', 'rosbags': 'logs', 'scipy': 'identify', 'serial': 'bus',
    'tornado': 'dashboard'}


class MissingPackage(InvalidInput):
    """An optional package is not installed; the message names it, its purpose, and the install command."""


def is_installed(module: str) -> bool:
    """Return whether a module of PURPOSES can be imported, without importing it."""
    return find_spec(module) is not None


def advice(module: str) -> str:
    """Return the sentence on a missing module of PURPOSES and its installation."""
    package = PACKAGES.get(module, module)
    return (f'the Python package {package}, which {PURPOSES[module]}, is not installed; in the checkout, '
            f'scripts/setup.bash {GROUPS[module]} installs it; elsewhere: python3 -m pip install {package}')


def require_ros() -> None:
    """Raise MissingPackage if ROS 2 cannot be imported."""
    if find_spec('rclpy') is None or find_spec('bev_preheat_msgs') is None:
        raise MissingPackage('this command needs ROS 2, which is missing; source the setup files of ROS 2 and of '
                             'the workspace that bev_preheat is built in')


def require(*modules: str) -> None:
    """Raise MissingPackage if one of these modules of PURPOSES is not installed."""
    missing = [module for module in modules if not is_installed(module)]
    if missing:
        raise MissingPackage([advice(module) for module in missing])
