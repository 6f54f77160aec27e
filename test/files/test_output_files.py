# SPDX-License-Identifier: Apache-2.0
"""The writer of all files: refusals, crashes and links."""

import errno
import os
from pathlib import Path
import signal
import socket
import stat
import subprocess
import sys

import pytest
from refusals import problems_of

from bev_preheat.errors import InvalidInput
from bev_preheat.files import output_files
from bev_preheat.files.output_files import check_outputs, check_writable, OutputFile, PICTURE_SUFFIXES, write_whole

OLD, NEW = b'old contents\n', b'new contents, longer than the old\n'


@pytest.fixture(autouse=True)
def in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def old(tmp_path):
    path = tmp_path / 'old.json'
    path.write_bytes(OLD)
    return path


def problems_with(*outputs, inputs=()):
    return problems_of(
        check_outputs, [OutputFile(f'--{number}', path) for number, path in enumerate(outputs)], inputs)


def assert_refused(path, sentence):
    """Check that a path is refused before anything is computed, and when it is written."""
    assert problems_with(path) == [f'--0: {sentence}']
    assert problems_of(write_whole, path, NEW) == [sentence]


# Not a regular file

def make_socket(path):
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(path.name)


OTHERS = {'a folder': os.mkdir, 'a named pipe': os.mkfifo, 'a socket': make_socket}


@pytest.mark.parametrize('through_link', [False, True], ids=['itself', 'through a link'])
@pytest.mark.parametrize('kind, make', OTHERS.items(), ids=OTHERS)
def test_what_is_no_file_is_refused_at_once_and_stays(tmp_path, kind, make, through_link):
    other = tmp_path / 'other'
    make(other)
    path = tmp_path / 'link' if through_link else other
    if through_link:
        path.symlink_to('other')
    before, names = other.lstat(), sorted(os.listdir())
    assert_refused(path, f'{path}: is {kind}; only a regular file can be written')
    after = other.lstat()
    assert (after.st_ino, after.st_mode) == (before.st_ino, before.st_mode)
    assert sorted(os.listdir()) == names


@pytest.mark.parametrize('kind', [stat.S_IFCHR, stat.S_IFBLK], ids=['characters', 'blocks'])
def test_a_device_is_refused(old, monkeypatch, kind):
    """The file is reported as a device, because a real one would need root, and might be damaged."""
    real = os.stat

    def as_device(path, *arguments, **options):
        status = real(path, *arguments, **options)
        if str(path) != str(old):
            return status
        return os.stat_result((kind | 0o666, *tuple(status)[1:]))

    monkeypatch.setattr(output_files.os, 'stat', as_device)
    assert_refused(old, f'{old}: is a device; only a regular file can be written')
    monkeypatch.undo()
    assert old.read_bytes() == OLD


def test_a_pipe_that_comes_while_it_is_written_is_not_replaced(old, monkeypatch):
    fsync = os.fsync

    def swap(handle):
        fsync(handle)
        old.unlink()
        os.mkfifo(old)

    monkeypatch.setattr(output_files.os, 'fsync', swap)
    with pytest.raises(InvalidInput, match='is a named pipe'):
        write_whole(old, NEW)
    assert stat.S_ISFIFO(old.lstat().st_mode)
    assert os.listdir(old.parent) == [old.name]


PATHS_THAT_ARE_NONE = {
    'empty': ('', "'': is a folder; a file is needed"),
    'folder to be': ('new/', 'new/: is a folder; a file is needed'),
    'this folder': ('.', '.: is a folder; only a regular file can be written'),
    'no folder': ('none/x', 'none/x: cannot be written: {folder}/none does not exist'),
    'below a file': ('old.json/x', f'old.json/x: cannot be a file: {os.strerror(errno.ENOTDIR)}'),
    'loop': ('loop', f'loop: cannot be a file: {os.strerror(errno.ELOOP)}'),
    'long name': ('x' * 300, 'x' * 300 + f': cannot be a file: {os.strerror(errno.ENAMETOOLONG)}'),
    'null': ('a\0b', 'a\0b: cannot be a file: a path must not have a NUL character')}


@pytest.mark.parametrize('path, sentence', PATHS_THAT_ARE_NONE.values(), ids=PATHS_THAT_ARE_NONE)
def test_a_path_that_cannot_be_a_files_is_refused(old, path, sentence):
    Path('loop').symlink_to('loop')
    assert_refused(path, sentence.format(folder=os.path.realpath('.')))
    assert sorted(os.listdir()) == ['loop', 'old.json']


@pytest.mark.parametrize('protected, sentence', [
    ('old.json', 'the file is write-protected'), ('', 'the folder {} is write-protected')])
def test_write_protection_is_respected(old, monkeypatch, protected, sentence):
    """Simulated with os.access, because root may write whatever the mode."""
    forbidden = os.path.realpath(os.path.join(old.parent, protected))
    access = os.access
    monkeypatch.setattr(output_files.os, 'access', lambda path, mode: path != forbidden and access(path, mode))
    assert_refused(old, f'{old}: cannot be written: {sentence.format(forbidden)}')
    assert old.read_bytes() == OLD


def test_a_folder_that_cannot_be_made_is_refused_before(old):
    with pytest.raises(InvalidInput, match=f'old.json/two/x: cannot be a file: {os.strerror(errno.ENOTDIR)}'):
        check_writable(old / 'two' / 'x', make_folder=True)


# Whole or not at all


CRASH = """
import os, signal, sys
from bev_preheat.files import output_files
{where}
output_files.write_whole(sys.argv[1], b'new' * 100_000)
"""


@pytest.mark.parametrize('where', [
    'os.fsync = lambda handle: os.kill(os.getpid(), signal.SIGKILL)',
    'os.replace = lambda *names: os.kill(os.getpid(), signal.SIGKILL)'],
    ids=['written in part', 'not yet in place'])
def test_a_process_that_is_killed_while_it_writes_leaves_the_old_file_whole(old, where):
    done = subprocess.run([sys.executable, '-c', CRASH.format(where=where), str(old)], timeout=60, check=False)
    assert done.returncode == -signal.SIGKILL
    assert old.read_bytes() == OLD


@pytest.mark.parametrize('error, told', [
    (KeyboardInterrupt(), '^$'),
    (OSError(errno.ENOSPC, 'No space left on device'), 'old.json: cannot be written: No space left on device')])
def test_what_interrupts_leaves_the_old_file_whole_and_no_temporary_one(old, monkeypatch, error, told):
    def interrupt(handle):
        raise error

    monkeypatch.setattr(output_files.os, 'fsync', interrupt)
    with pytest.raises((KeyboardInterrupt, InvalidInput), match=told):
        write_whole(old, NEW)
    assert os.listdir() == ['old.json']
    assert old.read_bytes() == OLD


# Modes, links, names

@pytest.mark.parametrize('mode', [0o600, 0o664, 0o755])
def test_an_existing_file_keeps_its_mode(old, mode):
    old.chmod(mode)
    before = os.umask(0o027)
    try:
        write_whole(old, NEW)
    finally:
        os.umask(before)
    assert stat.S_IMODE(old.stat().st_mode) == mode


@pytest.mark.parametrize('error', [None, PermissionError(1, 'Operation not permitted')])
def test_the_owner_is_kept_where_that_is_permitted(old, monkeypatch, error):
    """Root, who may start the planner, must not take over a user's file."""
    wanted = []

    def change_owner(handle, *owner):
        wanted.append(owner)
        if error:
            raise error

    monkeypatch.setattr(output_files.os, 'fchown', change_owner)
    status = old.stat()
    write_whole(old, NEW)
    assert wanted == [(status.st_uid, status.st_gid)]
    assert old.read_bytes() == NEW


def test_a_link_is_written_through(tmp_path, old):
    (tmp_path / 'deeper').mkdir()
    link = tmp_path / 'deeper' / 'link'
    link.symlink_to('../old.json')
    write_whole(link, NEW)
    assert os.readlink(link) == '../old.json'
    assert old.read_bytes() == NEW
    assert os.listdir('deeper') == ['link']


# Inputs and outputs of one run

@pytest.mark.parametrize('spelling', [
    'old.json', './old.json', '../{name}/old.json', '{folder}/old.json', '~/old.json',
    'deeper/../old.json', 'link', 'hard_link', 'linked_folder/old.json', 'linked_folder/link'])
def test_an_input_is_no_output_however_it_is_spelled(tmp_path, old, monkeypatch, spelling):
    monkeypatch.setenv('HOME', str(tmp_path))
    (tmp_path / 'deeper').mkdir()
    (tmp_path / 'link').symlink_to('old.json')
    (tmp_path / 'hard_link').hardlink_to(old)
    (tmp_path / 'linked_folder').symlink_to('.')
    path = spelling.format(folder=tmp_path, name=tmp_path.name)
    sentence = 'is the same file as the input'
    assert problems_with(path, inputs=['old.json']) == [
        f'--0: {path}: {sentence} old.json, which must not be overwritten']
    assert problems_with('old.json', inputs=[path]) == [
        f'--0: old.json: {sentence} {path}, which must not be overwritten']


def test_two_outputs_are_two_files_however_they_are_spelled():
    assert problems_with('new.json', './new.json') == [
        '--1: ./new.json: is the same file as --0; each output needs its own file']


@pytest.mark.parametrize('path', ['x', 'x.', 'x.bmp', '.png', 'x.png.gz', 'folder.png/x'])
def test_a_picture_needs_a_suffix_that_is_known(path):
    assert problems_of(check_outputs, [OutputFile('--plot', path, PICTURE_SUFFIXES)]) == [
        f'--plot: {path}: must end in .png or .svg or .pdf']
