# SPDX-License-Identifier: Apache-2.0
"""Finds the files in the package's config folder, by name or by path."""

from difflib import get_close_matches
import os
from pathlib import Path

from bev_preheat.errors import InvalidInput, LONGEST_QUOTE, quoted
from bev_preheat.files.input_files import check_input
from bev_preheat.files.installed import share_folder

# In a source tree, its own config folder is used.
_SOURCES = Path(__file__).resolve().parents[2]


def configuration_folder(kind: str) -> Path:
    """Return the folder of the package's files of a kind (`vehicles`, `itineraries`)."""
    if (_SOURCES / 'config').is_dir():
        return _SOURCES / 'config' / kind
    # Installed by pip they lie in the package, by colcon in the share folder.
    in_package = Path(__file__).resolve().parents[1] / 'config'
    return (in_package if in_package.is_dir() else share_folder() / 'config') / kind


def _files_beside(text: str) -> list[str]:
    """Return the files of the working folder with this name, whatever their suffix, as they must be given."""
    try:
        found = sorted(path.name for path in Path().iterdir() if path.stem == Path(text).stem and path.is_file())
    except OSError:
        return []
    return [f'./{name}' for name in found]


def find_configuration(kind: str, name_or_file: str | Path, suffix: str) -> Path:
    """
    Return the path of a file named on a command line or by a parameter.

    A text with a slash or with the suffix is a file; anything else is a name in the package's config
    folder. Raises InvalidInput with the known names.
    """
    text = str(name_or_file)
    if '/' in text or text.endswith(suffix):
        check_input(text)
        return Path(os.path.expanduser(text))
    folder = configuration_folder(kind)
    names = sorted(item.stem for item in folder.glob(f'*{suffix}'))
    if text in names:
        return folder / f'{text}{suffix}'
    near = [*_files_beside(text), *get_close_matches(text[:LONGEST_QUOTE], names, n=1)]
    hint = f'; did you mean {near[0]!r}?' if near else ''
    singular = 'signal map' if kind == 'signals' else (
        f'{kind[:-3]}y' if kind.endswith('ies') else kind.rpartition('/')[2][:-1])
    raise InvalidInput(
        f'{singular} {quoted(text)} is unknown{hint}; known: {", ".join(names)}; '
        f'or give a file ending in {suffix}')
