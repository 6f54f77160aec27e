# SPDX-License-Identifier: Apache-2.0
"""
Change the program in small ways and list the changes that no test notices: `make mutation`.

A change replaces an operator, a number, an argument or a value in one place. A seed draws the same sample of each
subject on every machine. Python files are changed by mutmut, which runs only the tests that call the changed
function; C files are changed here, and the library is rebuilt for each change. Tests over DDS are left out, as are
those marked `costly` without --costly. Changes of wording alone are not drawn.

The verdicts are written to out/mutation/verdicts.tsv. --again FILE tries the changes of such a file again, where
their code is still the same, and lists those that were noticed then and are not now.
"""

import argparse
import ast
from collections import Counter
from difflib import SequenceMatcher
import json
import os
from pathlib import Path
import random
import re
import shutil
import subprocess
import sys
import textwrap
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
WORK = ROOT / 'out/mutation'
LIBRARY = 'libbev_preheat_core.so'
# Files whose faults heat a battery that must not be heated, or turn away an input that is right.
SUBJECTS = {
    'gate': (
        'bev_preheat/control/decision.py', 'bev_preheat/control/command.py',
        'bev_preheat/control/heater.py', 'bev_preheat/vehicle/heater_controller.py'),
    'admission': (
        'bev_preheat/control/inbox.py', 'bev_preheat/control/inputs.py', 'bev_preheat/control/events.py',
        'bev_preheat/messages/battery_state.py', 'bev_preheat/messages/fields.py',
        'bev_preheat/messages/route_plan.py', 'bev_preheat/planning/situation.py',
        'bev_preheat/route/segments.py'),
    'limited run': (
        'bev_preheat/planning/limited_drive.py', 'bev_preheat/planning/limits.py'),
    'limited run in C': (
        'core/src/limited_run.c', 'core/src/limited_step.c',
        'core/src/limits.c'),
}
TESTS_OF_C = ('test/native', 'test/planning')
TESTS = ('test/control', 'test/estimation', 'test/vehicle', 'test/nodes', 'test/route/test_segments.py',
         'test/route/test_legs.py', 'test/estimation', *TESTS_OF_C)
# A change may make a loop endless. The tests' own limit is for a whole drive over DDS.
LIMITS = ('-o', 'timeout=60', '-p', 'no:cacheprovider', '--deselect',
          # mutmut's own imports.
          'test/planning/test_installed_methods.py::test_a_built_in_method_reads_no_entry_points', '-m')
QUICK, ALL = 'not dds and not deep and not linter and not costly', 'not dds and not deep and not linter'
# Read by the tests.
COPIED = ('config', 'core', 'docs', 'launch', 'msg_defs', 'resource', 'scripts', 'studies')
NOTICED = ('noticed', 'endless or crashed')
C_TOKEN = re.compile(
    r' (?:[<>=!]=|[<>]|&&|\|\||[-+*/]) |(?<=[ (\[{,-])\d+(?:\.\d+)?(?=[;,)\]} ])|bev_(?:mini|maxi)mum')
C_CHANGES = {'<': '<=', '<=': '<', '>': '>=', '>=': '>', '==': '!=', '!=': '==', '&&': '||', '||': '&&', '+': '-',
             '-': '+', '*': '/', '/': '*', 'bev_minimum': 'bev_maximum', 'bev_maximum': 'bev_minimum'}


class Mutant(NamedTuple):
    """One change: its name, file:line and `before -> after`; `text`: the whole changed file, '' for Python."""

    name: str
    where: str
    change: str
    text: str = ''


def python_mutants(path):
    """Return the Mutants of a Python file, as mutmut makes them."""
    from mutmut.mutation.file_mutation import mutate_file_contents
    from mutmut.utils.format_utils import (
        get_mutant_name,
        mangled_name_from_mutant_name,
        orig_function_and_class_names_from_key,
    )

    code = (ROOT / path).read_text()
    mutated = mutate_file_contents(path, code)
    lines, spans = mutated.code.split('\n'), mutated.line_span_by_function_name

    def function(name):
        """Return a function of the changed file as it would be written in the original one."""
        text = '\n'.join(lines[spans[name].start - 1:spans[name].end])
        return text[re.search('^ *def ', text, re.M).start():].replace(
            name, orig_function_and_class_names_from_key(name)[0], 1)

    found = []
    for name in mutated.mutant_names:
        before, after = function(f'{mangled_name_from_mutant_name(name)}__mutmut_orig'), function(name)
        # A value that becomes None fails at its first use: any test that executes the line notices.
        if _without_words(before) != _without_words(after) and after.count('None') <= before.count('None'):
            first = code.count('\n', 0, code.index(before)) + 1
            found.append(_mutant(get_mutant_name(Path(path), name), path, first, before, after))
    return found


def _without_words(function):
    """Return the syntax tree of a function as text, without the content of its strings."""
    tree = ast.parse(textwrap.dedent(function))
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            node.value = ''
    return ast.dump(tree)


def _mutant(name, path, first, before, after, text=''):
    """Return the Mutant that turns lines from line `first` on into others."""
    before, after = before.split('\n'), after.split('\n')
    _, begin, end, other, other_end = next(
        each for each in SequenceMatcher(None, before, after, autojunk=False).get_opcodes() if each[0] != 'equal')
    was, now = (' '.join(map(str.strip, each)) for each in (before[begin:end], after[other:other_end]))
    return Mutant(name, f'{path}:{first + begin}', f'{was} -> {now}', text)


def c_mutants(path):
    """Return the Mutants of a C file: operators, numbers, minima and maxima."""
    code = (ROOT / path).read_text()
    # Same length, so that places in it are places in the file.
    bare = re.sub(r'/\*.*?\*/|//[^\n]*|"[^"\n]*"|^ *#.*?$', lambda match: re.sub(r'[^\n]', '.', match[0]), code,
                  flags=re.M | re.S)
    found = []
    for number, match in enumerate(C_TOKEN.finditer(bare)):
        token = match[0].strip()
        if re.search(r'\bdouble [^;=,(]*\[$', bare[:match.start()]):
            # The size of an array.
            continue
        changed = C_CHANGES.get(token) or (f'{float(token) + 1.0}' if '.' in token else f'{int(token) + 1}')
        text = code[:match.start()] + match[0].replace(token, changed) + code[match.end():]
        found.append(_mutant(f'{path}#{number}', path, 1, code, text, text))
    return found


def configure(files, tests=TESTS, marks=ALL):
    """Write the settings of mutmut for some files and tests."""
    # Each worker is a fork of a process that has loaded the tests, but not run any: no result is kept from before.
    (WORK / 'pyproject.toml').write_text('[tool.mutmut]\n' + ''.join(
        f'{key} = {json.dumps(value)}\n' for key, value in {
            'source_paths': ['bev_preheat'], 'only_mutate': files, 'also_copy': COPIED,
            'pytest_add_cli_args_test_selection': tests, 'pytest_add_cli_args': [*LIMITS, marks],
            'process_isolation': 'forkserver', 'timeout_multiplier': 5.0, 'timeout_constant': 30.0,
            'track_dependencies': False, 'use_git_change_detection': False}.items()))


def try_python(mutants, tests, marks, workers):
    """Return {name: verdict} of changes of Python files."""
    from mutmut.stats import status_by_exit_code

    for folder in ('bev_preheat', 'setup.cfg', 'test', *COPIED):
        (WORK / folder).symlink_to(ROOT / folder)
    files = sorted({mutant.where.rpartition(':')[0] for mutant in mutants})
    configure(files, tests, marks)
    with open(WORK / 'mutmut.log', 'w') as log:
        done = subprocess.run(
            [sys.executable, '-m', 'mutmut', 'run', '--max-children', str(workers),
             *(mutant.name for mutant in mutants)], check=False, cwd=WORK, stdout=log, stderr=log)
    if done.returncode:
        raise SystemExit(f'mutmut failed; its output: {WORK}/mutmut.log')
    codes = {}
    for file in files:
        codes |= json.loads((WORK / f'mutants/{file}.meta').read_text())['exit_code_by_key']
    kinds = {'killed': 'noticed', 'survived': 'not noticed', 'no tests': 'no test'}
    return {mutant.name: kinds.get(status_by_exit_code[codes[mutant.name]], 'endless or crashed')
            for mutant in mutants}


def try_c(mutants, tests, marks):
    """Return {name: verdict} of changes of C files."""
    # core/CMakeLists.txt asks for the equations beside it.
    checkout, build = WORK / 'c', WORK / 'c/build'
    shutil.copytree(ROOT / 'core', checkout / 'core')
    (checkout / 'bev_preheat').symlink_to(ROOT / 'bev_preheat')
    subprocess.run(['cmake', '-S', checkout / 'core', '-B', build], check=True, stdout=subprocess.DEVNULL)
    (checkout / 'lib').mkdir()
    (checkout / 'lib' / LIBRARY).symlink_to(build / LIBRARY)
    environment = {**os.environ, 'AMENT_PREFIX_PATH': f'{checkout}:{os.environ["AMENT_PREFIX_PATH"]}',
                   'PYTHONPATH': f'{ROOT}:{ROOT}/studies:{os.environ.get("PYTHONPATH", "")}'}

    def verdict():
        subprocess.run(['cmake', '--build', build], check=True, capture_output=True)
        try:
            code = subprocess.run(
                [sys.executable, '-m', 'pytest', '-x', '-q', *LIMITS, marks, *tests], check=False, cwd=ROOT,
                env=environment, capture_output=True, timeout=1800).returncode
        except subprocess.TimeoutExpired:
            return 'endless or crashed'
        return {0: 'not noticed', 1: 'noticed'}.get(code, 'endless or crashed')

    if verdict() != 'not noticed':
        raise SystemExit(f'tests fail without any change: {" ".join(tests)}')
    verdicts = {}
    for mutant in mutants:
        file = checkout / mutant.where.rpartition(':')[0]
        original = file.read_text()
        file.write_text(mutant.text)
        verdicts[mutant.name] = verdict()
        file.write_text(original)
    return verdicts


def draw(subjects, sample, seed):
    """Return {subject: Mutants}, at most `sample` of each."""
    drawn = {}
    for subject in subjects:
        mutants = [mutant for path in SUBJECTS[subject]
                   for mutant in (c_mutants if path.endswith('.c') else python_mutants)(path)]
        chosen = random.Random(f'{seed} {subject}').sample(range(len(mutants)), min(sample, len(mutants)))
        drawn[subject] = [mutants[n] for n in sorted(chosen)]
    return drawn


def again(table):
    """Return {subject: Mutants} of a table of verdicts, as far as their code is the same, and {name: verdict}."""
    kept = [line.split('\t') for line in table.splitlines()]
    before = {name: verdict for _, verdict, name, _, _ in kept}
    changes = {name: change for _, _, name, _, change in kept}
    drawn = {subject: [mutant for mutant in mutants if changes.get(mutant.name) == mutant.change]
             for subject, mutants in draw(sorted({subject for subject, *_ in kept}), sys.maxsize, 0).items()}
    return drawn, before


def main():
    """Draw, try and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--sample', type=int, default=150, help='changes of each subject (default %(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='draws the sample (default %(default)s)')
    parser.add_argument('--subject', action='append', choices=SUBJECTS, help='one subject only; may be repeated')
    parser.add_argument('--workers', type=int, default=os.cpu_count(), help='tests at once (default %(default)s)')
    parser.add_argument('--tests', nargs='+', help=f'files and folders (default {" ".join(TESTS)}; for C '
                        f'{" ".join(TESTS_OF_C)})')
    parser.add_argument('--costly', action='store_true', help='with the tests that take long')
    parser.add_argument('--again', type=Path, metavar='FILE', help='try the changes of an earlier verdicts.tsv')
    arguments = parser.parse_args()
    kept = arguments.again.read_text() if arguments.again else ''
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    # mutmut reads its settings from its working directory, and writes there.
    os.chdir(WORK)
    configure([])
    drawn, before = again(kept) if kept else (
        draw(arguments.subject or SUBJECTS, arguments.sample, arguments.seed), {})
    verdicts, marks = {}, ALL if arguments.costly else QUICK
    python = [mutant for mutants in drawn.values() for mutant in mutants if not mutant.text]
    c = [mutant for mutants in drawn.values() for mutant in mutants if mutant.text]
    if python:
        verdicts |= try_python(python, arguments.tests or TESTS, marks, arguments.workers)
    if c:
        verdicts |= try_c(c, arguments.tests or TESTS_OF_C, marks)
    with open(WORK / 'verdicts.tsv', 'w') as table:
        for subject, mutants in drawn.items():
            for mutant in mutants:
                print(subject, verdicts[mutant.name], *mutant[:3], sep='\t', file=table)
                lost = before.get(mutant.name) in NOTICED and verdicts[mutant.name] not in NOTICED
                if lost or (not before and verdicts[mutant.name] not in NOTICED):
                    print(f'{mutant.where}: {mutant.change}  ({verdicts[mutant.name]})')
    for subject, mutants in drawn.items():
        counts = Counter(verdicts[mutant.name] for mutant in mutants)
        print(f'{subject}: {sum(counts[each] for each in NOTICED)} of {len(mutants)} changes noticed')


if __name__ == '__main__':
    main()
