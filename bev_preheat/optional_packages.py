# SPDX-License-Identifier: Apache-2.0
"""
Python packages that only a part of the program needs, and how to say that one is missing.

Whatever needs one asks here first, before it computes anything: it then ends with one line instead of
a traceback.
"""

from importlib.util import find_spec

from bev_preheat.errors import InvalidInput

# Module: what needs it.
PURPOSES = {
    'casadi': 'solves the nonlinear program',
    'distributed': 'runs studies on a cluster',
    'do_mpc': 'is what the nonlinear program is compared with',
    'elftools': 'reads object files',
    'matplotlib': 'draws figures',
    'pandas': 'holds results as tables',
    'plotext': 'draws the chart',
    'psutil': 'measures processes',
    'scipy': 'fits the vehicle to the paper',
    'unicorn': "emulates a control unit's processor",
}
# What they are called where they come from, if that is not the module's name; and the target of make that installs
# them, if that is not setup.
PACKAGES = {'do_mpc': 'do-mpc', 'elftools': 'pyelftools'}
TARGETS = {'do_mpc': 'bench', 'unicorn': 'footprint'}


class MissingPackage(InvalidInput):
    """An optional package is not installed; the message says which, what for, and what to type."""


def is_installed(module: str) -> bool:
    """Return whether a module of PURPOSES can be imported; it is not loaded."""
    return find_spec(module) is not None


def advice(module: str) -> str:
    """Return the sentence that says that a module of PURPOSES is missing, and how to install it."""
    package, target = PACKAGES.get(module, module), TARGETS.get(module, 'setup')
    return (f'the Python package {package}, which {PURPOSES[module]}, is not installed; in the checkout, '
            f'make {target} installs it; elsewhere: python3 -m pip install {package}')


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
