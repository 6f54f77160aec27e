# SPDX-License-Identifier: Apache-2.0
"""Where packages are installed; as ament_index_python says it, but also on a machine without ROS."""

from __future__ import annotations

import os
from pathlib import Path

from bev_preheat.errors import InvalidInput

PACKAGE = 'bev_preheat'
_INDEX = Path('share', 'ament_index', 'resource_index', 'packages')
_HERE = Path(__file__).resolve()


def installed_prefix(package: str) -> Path | None:
    """
    Return the prefix that a package is installed in, None where it is not.

    It is the first of AMENT_PREFIX_PATH that has the package, else the one that this file is installed in.
    """
    prefixes = [Path(prefix) for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if prefix]
    return next((prefix for prefix in (*prefixes, *_HERE.parents) if (prefix / _INDEX / package).is_file()), None)


def share_folder() -> Path:
    """Return the folder of the files that come with this package; raises InvalidInput where it is missing."""
    prefix = installed_prefix(PACKAGE)
    if prefix is None:
        raise InvalidInput(f'the files of {PACKAGE} are missing: it is neither in AMENT_PREFIX_PATH nor read in '
                           'its checkout; source the setup file of the install space')
    return prefix / 'share' / PACKAGE
