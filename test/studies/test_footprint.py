# SPDX-License-Identifier: Apache-2.0
"""Footprint of an export: object files, stack and instructions, each in a case with a known answer."""

from dataclasses import replace
import json
import struct
import subprocess

import pytest

from bev_preheat.ecu.export import Export
from bev_preheat.ecu.sources import core_sources, own_sources
from bev_preheat.ecu.vectors import Answer, METHODS, OK, Vector
from bev_preheat.errors import InvalidInput
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_studies.footprint import __main__ as footprint
from bev_preheat_studies.footprint.builds import Build, COMPUTER, CORTEX_M7, HERE, INCLUDES, Target
from bev_preheat_studies.footprint.emulated import instructions_in
from bev_preheat_studies.footprint.measured import measure, Measured, Plans
from bev_preheat_studies.footprint.object_bytes import Bytes, needed_for, read_object, total
from bev_preheat_studies.footprint.painted import PaintedStack
from bev_preheat_studies.footprint.situations import FootprintCase, Planned, situations
from bev_preheat_studies.footprint.tables import byte_rows, instruction_rows

SMALL = load_vehicle('small_car')

# --- Object files ---

PARTS = {
    'wanted.c': 'extern int other(int); int wanted(int a) { return other(a) + 1; }',
    'other.c': 'extern const int table[20]; static int calls[3];'
               'int other(int a) { calls[a % 3]++; return table[a] + calls[a % 2]; }',
    'table.c': 'const int table[20] = {1, 2, 3};',
    'unused.c': 'extern int wanted(int); const char text[1000] = "x"; int unused(int a) { return wanted(a); }'}


@pytest.fixture
def parts(tmp_path):
    for name, text in PARTS.items():
        (tmp_path / name).write_text(text)
        subprocess.run(['cc', '-Os', '-c', name], cwd=tmp_path, check=True)
    return [read_object(file) for file in sorted(tmp_path.glob('*.o'))]


@pytest.mark.needs('elftools')
def test_a_program_links_what_a_function_needs_and_nothing_else(parts):
    assert {file.path.name for file in needed_for(['wanted'], parts)} == {'wanted.o', 'other.o', 'table.o'}
    assert [file.path.name for file in needed_for(['table'], parts)] == ['table.o']


@pytest.mark.needs('elftools')
def test_bytes_are_code_constants_or_variables(parts):
    size = total(needed_for(['wanted'], parts))
    assert (size.constants, size.variables) == (20 * 4, 3 * 4)
    # Two short functions; the unwinding tables are not counted.
    assert 10 < size.code < 150
    assert total(needed_for(['table'], parts)) == Bytes(constants=20 * 4)
    assert total(needed_for(['unused'], parts)).constants == 20 * 4 + 1000


# --- Instructions ---

@pytest.mark.parametrize('halfwords, count', [
    ((0xBF00,), 1), ((0xB510, 0x4604, 0xBD10), 3),
    # bl, ldr.w, vadd.f64, each two halfwords; the second half of a bl looks like the first of one.
    ((0xF000, 0xF800), 1), ((0xF8D0, 0x0004), 1), ((0xEE30, 0x0B01), 1),
    ((0xE92D, 0x41F0, 0x4605, 0xF7FF, 0xFFFE), 3),
    # b, of one halfword, begins with 0b11100.
    ((0xE7FE, 0x2001), 2), ((), 0)])
def test_instructions_of_one_and_two_halfwords_are_counted(halfwords, count):
    assert instructions_in(struct.pack(f'<{len(halfwords)}H', *halfwords)) == count


# --- The stack ---

TAKES_STACK = """
#include "vehicle.h"
const bev_vehicle bev_ecu_vehicle;
static bev_status take(long bytes, bev_ecu_plan *plan) {
  volatile char taken[bytes];
  for (long n = 0; n < bytes; n++) {
    taken[n] = 1;
  }
  plan->on_s = (double)taken[bytes - 1];
  return BEV_OK;
}
bev_status bev_ecu_plan_switch(const bev_vehicle *v, const bev_trip *t, const bev_ecu_situation *s, double *m,
                               bev_ecu_plan *plan) {
  return take(1000 * t->steps, plan);
}
bev_status bev_ecu_plan_by_values(const bev_vehicle *v, const bev_trip *t, const bev_ecu_situation *s, double *m,
                                  uint8_t *f, bev_ecu_plan *plan) {
  return take(5000 + (long)s->target_c, plan) == BEV_OK ? BEV_LIMITED : BEV_OK;
}
"""


class PlansThatTakeStack:
    """A build whose plans use a given amount of stack."""

    def __init__(self, folder):
        for name, text in {**core_sources(), **own_sources(), 'plans.c': TAKES_STACK}.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
        self.folder = folder

    def link(self, name, *others):
        sources = [HERE / other if other.endswith('.c') else other for other in others]
        subprocess.run(['cc', '-O1', '-DBEV_MOST_STEPS=360', *INCLUDES, HERE / 'planned.c', *sources, 'plans.c',
                        '-o', name], cwd=self.folder, check=True)
        return self.folder / name


def asked(steps, target_c=0.0):
    columns = ([0.0] * (steps + 1), *(9 * ([0.0] * steps,)))
    return FootprintCase(Vector(columns, (0.5, 1.0, 2.0, 3.0, target_c, 4.0, 5.0), (Answer(OK),) * 2))


def test_the_stack_that_a_plan_overwrites_is_told_to_its_frames(tmp_path):
    program = PaintedStack(PlansThatTakeStack(tmp_path))
    planned = program.plan([(0, asked(2)), (1, asked(3)), (0, asked(9)), (1, asked(1, target_c=777.0))])
    assert [each.status for each in planned] == [0, 4, 0, 4]
    assert [each.told[0] for each in planned[::2]] == [1.0, 1.0]
    for each, taken in zip(planned, (2000, 5000, 9000, 5777)):
        assert taken <= each.stack_bytes < taken + 200


# --- An export ---

LATE = replace(SMALL, heat_path=HeatPath(45.0, 20e3, 400.0))


@pytest.fixture(scope='module')
def measured(tmp_path_factory):
    """The footprint of an export of a vehicle with a heat path on this computer."""
    folder = tmp_path_factory.mktemp('export')
    exported = [FootprintCase(vector) for vector in Export(LATE, folder, []).write(6, 4, lambda: None)]
    return measure(Build(COMPUTER, '-O0', folder, 360, 32), LATE.heat_path, exported, (10, 20))


@pytest.mark.deep
@pytest.mark.costly
@pytest.mark.needs('elftools')
def test_each_plan_is_held_against_that_of_python(measured):
    on_routes = measure(measured.build, measured.path, situations(LATE, (), 1, 4))
    assert measured.differ == on_routes.differ == 0
    assert [situation.steps for situation in on_routes.situations] == [360, 120, 143]
    planned = measured.plans['value_function'].planned
    # By 2 ms a plan is another one, unless it was searched for: then cost and arrival count.
    for is_exact, agrees in (True, False), (False, True):
        each, (status, *costs, told) = next(
            (each, plan) for each, plan in zip(measured.situations, planned)
            if each.vector.answers[1].heats and each.vector.answers[1].is_exact == is_exact)
        assert each.agrees(1, Planned(status, *costs, told)) and status == OK
        assert each.agrees(1, Planned(status, *costs, (told[0] + 2e-3, *told[1:]))) == agrees
        assert not each.agrees(1, Planned(status, *costs, (*told[:7], told[7] + 90.0, *told[8:])))
        assert not each.agrees(1, Planned(status, *costs, (*told[:8], told[8] - 50.0, told[9])))
        assert not each.agrees(1, Planned(4, *costs, told))


@pytest.mark.costly
@pytest.mark.needs('elftools')
def test_value_function_takes_more_of_everything(measured):
    switch, by_values = (measured.plans[method] for method in METHODS)
    assert by_values.linked.code > switch.linked.code > 10_000
    assert by_values.linked.constants >= switch.linked.constants > measured.vehicle.constants > 0
    assert by_values.linked.variables == switch.linked.variables == 0
    assert by_values.stack_bytes > switch.stack_bytes > 500
    assert measured.everything.code >= by_values.linked.code
    for direct, late, most in measured.memory_bytes.values():
        assert direct < late < most
    rows = byte_rows([measured], 'value_function')
    assert rows[0] == ['', f'{COMPUTER.name}, -O0'] and rows[1][0][0] == 'code'
    assert rows[1][0][1].replace(' ', '') == str(by_values.linked.code)


@pytest.mark.costly
def test_a_compiler_that_fails_is_quoted(tmp_path):
    Export(SMALL, tmp_path, []).write(3, 4, lambda: None)
    build = Build(Target('this', 'cc', flags=('-Dbev_run=1bad',)), '-O0', tmp_path, 360, 32)
    with pytest.raises(InvalidInput, match='this, -O0: make ends with 2: .*error'):
        build.make_library()


# --- The tables ---

HEATED, UNHEATED = Answer(OK, (100.0, *9 * (0.0,))), Answer(OK, (float('nan'), *9 * (0.0,)))


def counted(steps, instructions, *, heated=True, limited=False, route=''):
    """A situation, and the cost of its plans by both methods."""
    answer = HEATED if heated else UNHEATED
    situation = replace(asked(steps), route=route)
    status = 4 if limited else OK
    return (replace(situation, vector=replace(situation.vector, answers=(answer, answer))),
            Planned(status, 9, instructions, ()), Planned(OK, 9, 2 * instructions, ()))


def test_instructions_are_told_for_heated_plans_by_length_and_limit():
    plans = [counted(40, 1_000_000), counted(60, 3_000_000), counted(50, 7_000_000), counted(61, 9_000_000),
             counted(50, 8_000_000, heated=False), counted(45, 5_000_000, limited=True),
             counted(360, 40_000_000), counted(45, 6_000_000, route='reference')]
    situations_of, switched, by_values = zip(*plans)
    build = Build(CORTEX_M7, '-Os', HERE, 360, 32)
    headings, rows, _ = instruction_rows([Measured(
        build, HeatPath(), situations_of,
        {'optimal_switch': Plans(Bytes(), list(switched)), 'value_function': Plans(Bytes(), list(by_values))},
        Bytes(), Bytes(), 0, {})])
    assert headings[3:] == ['40 to 60 steps', '360 steps', 'route reference', 'route alpine_pass']
    assert [row[2:] for row in rows] == [
        # The answers decide whether a plan heats, also with an active limit.
        ['optimal_switch', '1, 4, 7 (4)', '40', '6', '-'],
        ['value_function, no limit active', '2, 6, 14 (3)', '80', '12', '-'],
        ['value_function, a limit active', '10', '-', '-', '-']]


@pytest.mark.deep
@pytest.mark.needs('elftools')
def test_the_command_tells_what_it_can_where_the_other_compiler_is_missing(monkeypatch, tmp_path, capsys):
    for name, value in {'DRAWN': 12, 'LONG': 0, 'SEED': 4, 'LEVELS': ('-O0',), 'PATHS': (HeatPath(),),
                        'CORTEX_M7': replace(CORTEX_M7, compiler='no-such-compiler')}.items():
        monkeypatch.setattr(footprint, name, value)
    file = tmp_path / 'footprint.json'
    assert footprint.main(['--vehicle', 'small_car', '--block', '8', '--json', str(file)]) == 0
    told = capsys.readouterr().out
    for words in ('optimal_switch [bytes]', 'value_function [bytes]', 'working memory, 360 steps',
                  'not measured: Cortex-M7', 'sudo apt install'):
        assert words in told
    builds = json.loads(file.read_text())['builds']
    assert [(build['level'], build['differ']) for build in builds] == [('-O0', 0)]
    # The stack shrinks with the block: with 32 states it is 2 496 bytes.
    assert builds[0]['methods']['optimal_switch']['stack_bytes'] < 2200


@pytest.mark.parametrize('arguments, problem', [
    (['--block', '0'], '--block: 0 is not allowed; it must be 1 ... 32'),
    (['--vehicle', 'none'], "vehicle 'none'")])
def test_what_is_wrong_is_said_in_one_line(capsys, arguments, problem):
    assert footprint.main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert problem in line
