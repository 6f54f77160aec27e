# SPDX-License-Identifier: Apache-2.0
"""The C sources of an export: those of the core that planning needs, and the export's own sources."""

from __future__ import annotations

from pathlib import Path
import re

from bev_preheat.code_generation import c_source
from bev_preheat.errors import InvalidInput
from bev_preheat.files.configuration import installed_prefix

# If the sources are read in place, the C files beside them belong to them.
_CHECKOUT = Path(__file__).resolve().parents[2]
_OWN = Path(__file__).resolve().parent / 'c'
CORE = 'bev_preheat_core'
# Files for bev_find_switch, bev_find_two_switches and bev_plan_by_values; headers as they are included.
SOURCES = (
    'accounts.c', 'checks.c', 'curves.c', 'limited_run.c', 'limited_step.c',
    'limits.c', 'prices.c', 'runs.c', 'switch_search.c', 'two_switches.c', 'value_function.c',
    'value_layers.c', 'value_path.c', 'value_run.c', 'value_steps.c')
INCLUDED = re.compile(r'^#include "([^/"]+)"', re.MULTILINE)
OWN_FILES = ('MISRA.md', 'Makefile', 'README.md', 'bev_ecu.c', 'bev_ecu.h', 'bev_ecu_shared.h', 'bev_ecu_switch.c',
             'bev_ecu_values.c', 'check.c', 'main.c', 'vehicle.h')


def core_sources() -> dict[str, str]:
    """
    Return {path in the export: text} of the core, its generated headers included.

    Raises InvalidInput where the core's sources are neither in a checkout nor installed.
    """
    include, source = _core_folders()
    files = {}
    try:
        files[f'include/{CORE}/core.h'] = (include / CORE / 'core.h').read_text(encoding='utf-8')
        wanted = [*SOURCES]
        for name in wanted:
            files[f'src/{name}'] = text = (source / name).read_text(encoding='utf-8')
            wanted += [header for header in INCLUDED.findall(text) if header not in wanted]
    except OSError as error:
        raise InvalidInput(f'{error.filename}: the source of {CORE} cannot be read: {error.strerror}; '
                           'build the packages of one version') from error
    generated = f'include/{CORE}_generated'
    return {**files, f'{generated}/constants.h': c_source.constants_header(),
            f'{generated}/formulas.h': c_source.formulas(),
            f'{generated}/steps.h': c_source.steps()}


def own_sources() -> dict[str, str]:
    """Return {path in the export: text} of the files that do not depend on the vehicle."""
    return {name: (_OWN / name).read_text(encoding='utf-8') for name in OWN_FILES}


def _core_folders() -> tuple[Path, Path]:
    """Return the folders of the core's public headers and of its sources."""
    core = _CHECKOUT / 'core'
    if (core / 'src').is_dir():
        return core / 'include', core / 'src'
    prefix = installed_prefix(CORE)
    if prefix is None:
        raise InvalidInput(f'the sources of {CORE} are missing: the package is not installed; build it from a '
                           'checkout: colcon build --base-paths . core msg_defs')
    return prefix / 'include', prefix / 'share' / CORE / 'src'
