# SPDX-License-Identifier: Apache-2.0
"""Finds installed packages like ament_index_python, but also on machines without ROS."""

from __future__ import annotations

import os
from pathlib import Path

from bev_preheat.errors import InvalidInput

PACKAGE = 'bev_preheat'
_INDEX = Path('share', 'ament_index', 'resource_index', 'packages')
_HERE = Path(__file__).resolve()


def installed_prefix(package: str) -> Path | None:
    """
    Return the prefix that a package is installed in, None if it is not installed.

    The first prefix in AMENT_PREFIX_PATH with the package is used, else the prefix of this file.
    """
    prefixes = [Path(prefix) for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if prefix]
    return next((prefix for prefix in (*prefixes, *_HERE.parents) if (prefix / _INDEX / package).is_file()), None)


def share_folder() -> Path:
    """Return the folder of the files that come with this package; raises InvalidInput if it is missing."""
    prefix = installed_prefix(PACKAGE)
    if prefix is None:
        raise InvalidInput(f'the files of {PACKAGE} are missing: AMENT_PREFIX_PATH does not lead to them; source '
                           'the setup file of the install space')
    return prefix / 'share' / PACKAGE
