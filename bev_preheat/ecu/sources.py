# SPDX-License-Identifier: Apache-2.0
"""The C sources of an export: those of the core that planning needs, and those that are the export's own."""

from __future__ import annotations

from pathlib import Path

from ament_index_python.packages import get_package_prefix, PackageNotFoundError

from bev_preheat.compiled import c_source
from bev_preheat.errors import InvalidInput

# Where the sources are read in place, their own files are the ones that belong to them.
_CHECKOUT = Path(__file__).resolve().parents[2]
_OWN = Path(__file__).resolve().parent / 'c'
CORE = 'bev_preheat_core'
# What bev_plan_switch and bev_find_two_switches need; the headers beside them are taken as well.
SOURCES = ('accounts.c', 'caution.c', 'checks.c', 'curves.c', 'limits.c', 'prices.c', 'runs.c',
           'switch_search.c', 'two_switches.c')
HEADERS = (
    'arithmetic.h', 'bracketing.h', 'caution.h', 'checks.h', 'curves.h', 'limits_of_run.h', 'means.h',
    'prices.h', 'step_limits.h', 'steps_of_model.h')
OWN_FILES = ('MISRA.md', 'Makefile', 'README.md', 'bev_ecu.c', 'bev_ecu.h', 'check.c', 'main.c', 'vehicle.h')


def core_sources() -> dict[str, str]:
    """
    Return {path in the export: text} of the core, its generated headers included.

    Raises InvalidInput where the core's sources are neither in a checkout nor installed.
    """
    include, source = _core_folders()
    try:
        files = {f'include/{CORE}/core.h': (include / CORE / 'core.h').read_text(encoding='utf-8'),
                 **{f'src/{name}': (source / name).read_text(encoding='utf-8')
                    for name in (*SOURCES, *HEADERS)}}
    except OSError as error:
        raise InvalidInput(f'{error.filename}: the source of {CORE} cannot be read: {error.strerror}; '
                           'build the packages of one version') from error
    generated = f'include/{CORE}_generated'
    return {**files, f'{generated}/formulas.h': c_source.formulas(),
            f'{generated}/steps.h': c_source.steps()}


def own_sources() -> dict[str, str]:
    """Return {path in the export: text} of what does not depend on the vehicle."""
    return {name: (_OWN / name).read_text(encoding='utf-8') for name in OWN_FILES}


def _core_folders() -> tuple[Path, Path]:
    """Return the folders of the core's public headers and of its sources."""
    core = _CHECKOUT / 'core'
    if (core / 'src').is_dir():
        return core / 'include', core / 'src'
    try:
        prefix = Path(get_package_prefix(CORE))
    except PackageNotFoundError:
        raise InvalidInput(f'the sources of {CORE} are missing: the package is not installed; build it from a '
                           'checkout: colcon build --base-paths . core msg_defs') from None
    return prefix / 'include', prefix / 'share' / CORE / 'src'
