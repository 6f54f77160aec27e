# SPDX-License-Identifier: Apache-2.0
"""
The commands of a page of the documentation, run as a reader types them.

In a ```console block each line that begins with `$ preheat` or `$ python3 FILE` is run, and its output must
contain the lines up to the next command; an ellipsis stands for omitted text. The exit status must be 0, or 2
if a line `preheat: error:` is shown. The commands of a page run in order in one folder, which contains the page's
code blocks with a caption as files, and the scripts beside the page to which it links; packages of docs/examples
that the page names are installed.
"""

from dataclasses import dataclass
from pathlib import Path
import re
from runpy import run_path
import shlex
import sys

import installed_packages
import pytest

from bev_preheat.commands.main import main

EXAMPLES = Path(__file__).resolve().parents[1] / 'docs' / 'examples'
FENCE = re.compile(r'^```(\S*)[^\n]*\n(.*?)^```', re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Command:
    """A command of a page: its words, and the lines that are shown below it."""

    words: list
    shown: list

    @property
    def status(self):
        return 2 if any(line.startswith('preheat: error:') for line in self.shown) else 0


def commands_of(text):
    """Return the commands in the console blocks of a page."""
    found = []
    for language, block in FENCE.findall(text):
        if language != 'console':
            continue
        for line in block.replace('\\\n', ' ').splitlines():
            if line.startswith('$ '):
                words = shlex.split(line.removeprefix('$ '))
                assert words[0] in RUNNERS, f'not to be run, so it belongs into ```bash: {line}'
                found.append(Command(words, []))
            elif line.strip():
                found[-1].shown.append(line)
    return found


def files_of(page):
    """Return {name: content} of the scripts to which a page links, and of its code blocks with a caption."""
    text = page.read_text()
    files = {name: (page.parent / name).read_text() for name in re.findall(r'\]\((\w+\.py)\)', text)}
    for _, block in FENCE.findall(text):
        captioned = re.match(r':caption: (\S+)\n\n(.*)', block, re.DOTALL)
        if captioned:
            files[captioned.group(1)] = captioned.group(2)
    return files


def node_commands_of(text):
    """Return [(executable, its ROS arguments)] of the lines `ros2 run bev_preheat` in bash blocks."""
    found = []
    for language, block in FENCE.findall(text):
        if language == 'bash':
            for line in block.replace('\\\n', ' ').splitlines():
                words = shlex.split(line)
                if words[:3] == ['ros2', 'run', 'bev_preheat']:
                    assert words[4:5] in ([], ['--ros-args']), line
                    found.append((words[3], words[5:]))
    return found


def _run_script(arguments):
    """Run a Python script of the page in this process; returns the exit status."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(sys, 'argv', arguments)
        run_path(arguments[0], run_name='__main__')
    return 0


RUNNERS = {'preheat': main, 'python3': _run_script}


def _words(text):
    return ' '.join(text.split())


def run_page(page, folder, monkeypatch, capfd):
    """Run the commands of a page in a folder, and compare their output with the page."""
    text = page.read_text()
    monkeypatch.chdir(folder)
    # Wide enough for every table.
    monkeypatch.setenv('COLUMNS', '250')
    for example in sorted(set(re.findall(r'/examples/(\w+)', text))):
        if not (EXAMPLES / example / 'pyproject.toml').is_file():
            continue
        (installed := folder / 'installed' / example).mkdir(parents=True)
        installed_packages.put_example(installed, example)
        installed_packages.use_folder(monkeypatch, installed)
    for name, content in files_of(page).items():
        (folder / name).write_text(content)
    for command in commands_of(text):
        assert RUNNERS[command.words[0]](command.words[1:]) == command.status, command.words
        output = _words(''.join(capfd.readouterr()))
        for line in command.shown:
            rest = output
            for part in filter(None, map(str.strip, _words(line).split('…'))):
                _, found, rest = rest.partition(part)
                assert found, f'not in the output of {command.words}: {part}'
