# SPDX-License-Identifier: Apache-2.0
"""The package's version, from package.xml, for setup.py and `preheat --version`."""

from pathlib import Path
from xml.etree import ElementTree

from bev_preheat.files.installed import installed_prefix, PACKAGE, share_folder

MANIFEST = 'package.xml'


def version() -> str:
    """Return the version of the running sources, or of the installed package, as a text."""
    manifest = Path(__file__).resolve().parents[2] / MANIFEST
    if not manifest.is_file():
        if installed_prefix(PACKAGE) is None:
            # Installed by pip.
            from importlib.metadata import version as version_of
            return version_of(PACKAGE)
        manifest = share_folder() / MANIFEST
    return ElementTree.parse(manifest).findtext('version', '').strip()
