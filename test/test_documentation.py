# SPDX-License-Identifier: Apache-2.0
"""
README and docs: commands work, links have targets, the reference is complete, versions and citation agree.

Console blocks are run as typed_pages.py describes. Commands that must not run are in ```bash or ```text.

The ```python blocks of a page are run in order, like the cells of a notebook. If a comment follows `print(…)` on
its line, the output must have the comment's numbers, to the comment's digits.
"""

import configparser
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
import re
import sys
from xml.etree import ElementTree

import pytest
from typed_pages import commands_of, FENCE, files_of, run_page
import yaml

from bev_preheat.commands.main import main, SUBCOMMANDS
from bev_preheat.planning.status import Status

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', ROOT / 'QUALITY_DECLARATION.md',
         *sorted(path for path in (ROOT / 'docs').rglob('*.md'))]
NEED_CASADI = {'optimum', 'compare', 'reproduce', 'sweep', 'identify'}
# test/nodes/test_tutorials.py runs it, and the nodes that it ends with.
WITH_NODES = {'docs/tutorials/from_files.md'}
# They take most of the time: whole drives, solvers, a hundred plans. The same commands run daily on shorter inputs
# in test/recording, test/commands and test/interface.
DEEP = {'docs/tutorials/cold_arrival.md', 'docs/explanation/planning.md', 'docs/explanation/worth.md',
        'docs/how-to/ecu.md', 'docs/reference/python.md'}


def name_of(page):
    return page.relative_to(ROOT).as_posix()


def depth_of(page):
    return [pytest.mark.deep] * (name_of(page) in DEEP)


def typed_pages():
    for page in PAGES:
        commands = commands_of(page.read_text())
        if commands and name_of(page) not in WITH_NODES:
            needs_casadi = any(command.words[1] in NEED_CASADI for command in commands)
            needs_can = '.dbc' in page.read_text()
            needs_mcap = '.mcap' in page.read_text()
            yield pytest.param(page, id=name_of(page), marks=[*depth_of(page), *(
                pytest.mark.needs(package) for package, is_needed in (
                    ('casadi', needs_casadi),
                    ('can', needs_can), ('cantools', needs_can), ('mcap', needs_mcap)) if is_needed)])


@pytest.mark.costly
@pytest.mark.parametrize('page', list(typed_pages()))
def test_what_is_typed_gives_what_is_shown(page, tmp_path, monkeypatch, capfd):
    run_page(page, tmp_path, monkeypatch, capfd)


def test_the_pages_have_commands_and_python_that_are_run():
    pages = {page.id for page in typed_pages()}
    assert pages >= {'README.md', 'docs/tutorials/first_plan.md', 'docs/tutorials/your_car.md',
                     'docs/tutorials/your_route.md'}
    assert 'docs/reference/python.md' in {page.id for page in PAGES_WITH_PYTHON}


# --- Python ---


def python_of(text):
    return [block for language, block in FENCE.findall(text) if language == 'python']


PAGES_WITH_PYTHON = [pytest.param(page, id=name_of(page), marks=depth_of(page))
                     for page in PAGES if python_of(page.read_text())]


@pytest.mark.costly
@pytest.mark.parametrize('page', PAGES_WITH_PYTHON)
def test_python_of_a_page_runs(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, content in files_of(page).items():
        (tmp_path / name).write_text(content)
    names = {}
    for number, block in enumerate(python_of(page.read_text()), 1):
        exec(compile(block, f'{name_of(page)}, block {number}', 'exec'), names)
        printed = capsys.readouterr().out.splitlines()
        # A print() in a loop or a branch has no comment.
        shown = re.findall(r'^ *print\(.*\)(?:  # (.*))?$', block, re.MULTILINE)
        if len(shown) == len(printed):
            for line, comment in zip(printed, shown, strict=True):
                compare(line, comment)
        else:
            assert not any(shown), f'{name_of(page)}, block {number}: print() beside a comment must print one line'


def compare(line, comment):
    """Compare a printed line with the comment beside its print(): the same numbers to the comment's digits."""
    for number in re.findall(r'-?\d+(?:\.\d+)?', comment):
        assert any(float(f'{float(printed):.{len(number.partition(".")[2])}f}') == float(number)
                   for printed in re.findall(r'-?\d+(?:\.\d+)?(?:e-?\d+)?', line)), f'{line!r} is not {comment!r}'


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_each_python_block_runs_somewhere(page):
    # test/nodes/test_tutorials.py runs the tutorials for ROS.
    text = page.read_text()
    assert not re.search(r'^```(?:py|Python|ipython|pycon|{code-block} python)\b', text, re.MULTILINE), (
        'its name is python, and a script is a file beside the page')
    run = {command.words[1] for command in commands_of(text) if command.words[0] == 'python3'}
    assert {name for name in files_of(page) if name.endswith('.py')} - run <= {
        'by_hand': {'by_hand.py'}, 'your_bus': {'play_car.py'}}.get(page.stem, set())


def test_a_wrong_figure_in_a_comment_is_found():
    compare('32.028 25.00001', '32.0 min, 25.0 °C')
    with pytest.raises(AssertionError, match='is not'):
        compare('32.028 25.00001', '31.9 min, 25.0 °C')


def test_the_key_figures_are_those_of_the_tables():
    """Each figure of the README stands, to its digits, on the page that names the command for it."""
    rows = (ROOT / 'README.md').read_text().partition('## Key figures')[2].partition('\n## ')[0]
    results = [row.split('|')[2] for row in rows.splitlines() if row.startswith('|')][2:]
    shown = re.findall(r'\d+(?:\.\d+)?', (ROOT / 'docs/explanation/how_good.md').read_text())
    for figure in re.findall(r'\d+(?:\.\d+)?', re.sub(r'\(docs/[^)]*\)', '', ' '.join(results))):
        digits = len(figure.partition('.')[2])
        assert figure in {f'{float(each):.{digits}f}' for each in shown}, figure


def test_the_scenarios_are_counted():
    number = len(list((ROOT / 'config/scenarios').glob('*.yaml')))
    assert f'Of the {number} of `preheat scenario`' in (ROOT / 'docs/explanation/how_good.md').read_text()


def test_the_readme_is_a_page():
    assert len((ROOT / 'README.md').read_text().splitlines()) <= 150


# --- links ---


@pytest.fixture(scope='module')
def reference():
    spec = spec_from_file_location('generated_reference', ROOT / 'docs/generated_reference.py')
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope='module')
def generated(reference):
    return reference.parts()


def anchors(path):
    """Return the anchors of a page's headings, as Git hosts and the site make them."""
    text = path.read_text()
    headings = re.findall(r'^#+ (.*)$', FENCE.sub('', text), re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_links_lead_somewhere(page):
    for target in re.findall(r'\]\(([^)\s]+)\)', FENCE.sub('', page.read_text())):
        if target.startswith(('https://', 'http://')):
            continue
        name, _, anchor = target.partition('#')
        path = (page.parent / name).resolve() if name else page
        assert path.exists(), f'{name_of(page)} links to {target}'
        if anchor:
            assert anchor in anchors(path), f'{name_of(page)} links to {target}'


def test_code_comments_name_files_that_exist():
    folders = 'bev_preheat', 'config', 'scripts', 'studies', 'test'
    files = {path.name for path in ROOT.glob('*.py')}.union(
        path.name for folder in (*folders, 'docs') for path in (ROOT / folder).rglob('*.py'))
    for folder in folders:
        for path in (ROOT / folder).rglob('*'):
            if path.suffix in ('.py', '.yaml', '.txt', '.bash'):
                text = path.read_text()
                for name in re.findall(r'docs/[\w/-]+\.(?:md|py)', text):
                    assert (ROOT / name).exists(), f'{name_of(path)} names {name}'
                if folder != 'test':
                    for name in re.findall(r'\b\w+\.py\b', text):
                        assert name in files, f'{name_of(path)} names {name}'


def test_tests_that_make_runs_exist():
    named = [name for path in (ROOT / 'Makefile', *(ROOT / 'scripts').glob('*.bash'))
             for name in re.findall(r'(?<![\w./])test/[\w./]*\w', path.read_text())]
    assert named
    assert [name for name in named if not (ROOT / name).exists()] == []


FOLDERS_OF_NAMES = (ROOT, ROOT / 'bev_preheat', ROOT / 'studies/bev_preheat_studies')


@pytest.mark.parametrize('page', [
    page for page in PAGES if page.parent == ROOT or page.parent.name in ('explanation', 'docs')],
    ids=name_of)
def test_files_of_the_project_that_a_page_names_exist(page):
    text = FENCE.sub('', page.read_text())
    names = re.findall(r'`((?:\w[\w.-]*/)+[\w.-]+\.(?:py|c|h|yaml|xml|rst|bash))`', text)
    # NAME is a placeholder of a recipe.
    assert not {name for name in names
                if 'NAME' not in name and not any((folder / name).exists() for folder in FOLDERS_OF_NAMES)}


def test_each_room_is_in_the_table_of_rooms():
    table = (ROOT / 'CONTRIBUTING.md').read_text().partition('## Rooms')[2].partition('\n#')[0]
    named = [name for row in cells(table) for name in re.findall(r'\w+', row[0]) if name != 'room']
    assert sorted(named) == sorted(path.parent.name for path in (ROOT / 'bev_preheat').glob('*/__init__.py'))


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_modules_that_a_page_runs_do_something(page):
    # NAME is a placeholder.
    for module in set(re.findall(r'-m\s+(bev_preheat[\w.]*\w)', page.read_text())) - {'bev_preheat_studies.NAME'}:
        place = ROOT / ('studies' if module.startswith('bev_preheat_studies') else '') / module.replace('.', '/')
        assert (place / '__main__.py').exists() or (
            "if __name__ == '__main__':" in place.with_suffix('.py').read_text()), module


def test_the_reviewer_finds_the_licence_of_each_package():
    table = (ROOT / 'docs/explanation/reviewer.md').read_text().partition('## Licences')[2].lower()
    for name in ('demo', 'optional'):
        packages, _, _ = (ROOT / f'scripts/requirements-{name}.txt').read_text().partition('bring along')
        # Selenium is for tests alone.
        named = set(re.findall(r'^([\w-]+)==', packages, re.MULTILINE)) - {'selenium'}
        assert named and {package for package in named if package not in table} == set()


# --- the reference ---


def cells(table):
    """Return the rows of a Markdown table, without code marks."""
    return [[cell.strip().strip('`') for cell in re.split(r'(?<!\\)\|', line)[1:-1]]
            for line in table.splitlines() if line.startswith('| ')]


def test_generated_parts_are_in_the_pages_as_they_are_generated(reference, generated):
    pages = reference.filled_pages()
    found = re.findall(r'^<!-- generated: (\w+) -->$', '\n'.join(pages.values()), re.MULTILINE)
    assert sorted(found) == sorted(generated)
    differing = [name_of(path) for path, text in pages.items() if path.read_text(encoding='utf-8') != text]
    assert not differing, 'run python docs/generated_reference.py --write'


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_no_text_is_included_by_the_build_alone(page):
    # Such text is missing on a repository's web page.
    assert not re.search(r'^```{(literal)?include}', page.read_text(), re.MULTILINE)


def test_every_status_is_explained(generated):
    rows = cells(generated['statuses'])[1:]
    assert [(int(number), name) for number, name, *_ in rows] == [
        (status.value, status.name) for status in Status]
    assert all(meaning and level in ('OK', 'WARN', 'ERROR') for *_, meaning, level in rows)
    steadied = (ROOT / 'docs/reference/statuses.md').read_text().partition('A change among')[2].partition(' is')[0]
    assert set(re.findall(r'`(\w+)`', steadied)) == {each.name for each in Status if each.meaning.is_of_plan}


@pytest.mark.parametrize('path', sorted((ROOT / 'msg_defs').glob('*/*.*')), ids=lambda path: path.stem)
def test_every_field_of_a_message_has_a_comment(path):
    # The reference of the messages is these files; fields below each other may share a comment.
    for block in re.split(r'\n(?:\n|---\n)', path.read_text()):
        assert block.startswith('#'), block
    assert path.name in (ROOT / 'docs/reference/topics.md').read_text()


def test_parameters_have_default_range_and_meaning(generated):
    shared, planner, *_, simulator, _, _ = generated['parameters'].split('## ')[1:]
    assert ('* `battery_state_timeout` = 5.0 (0.1…60 s): A battery state older than this is stale'
            in planner.splitlines())
    assert '* `charger_power` = 0.0 (1000…2e6 W; 0 or NaN: not known): Power of that charger' in shared
    assert '`charger_power`\\*' in simulator
    # An asterisk: at the start only.
    assert '* `route`\\* = ' in simulator
    assert '* `speed_up` = ' in simulator


def test_every_subcommand_is_listed(generated):
    titles = re.findall(r'^## `preheat ([\w-]+)', generated['command_line'], re.MULTILINE)
    studies = (ROOT / 'docs/how-to/studies.md').read_text()
    assert list(dict.fromkeys(titles)) == [
        name for name, module in SUBCOMMANDS.items()
        if not (module.startswith('bev_preheat_studies.') and f'preheat {name} ' in studies)]
    assert '`preheat vehicle new`' in generated['command_line']
    assert '60 % of the power' in generated['command_line']


def test_every_option_is_listed(generated, capsys):
    shared = generated['command_line'].split('\n## ')[0]
    for section in generated['command_line'].split('\n## ')[1:]:
        command = section.splitlines()[0].strip('`').split()[1:]
        with pytest.raises(SystemExit):
            main([*command, '--help'])
        for option in set(re.findall(r'^ +(--[\w-]+)', capsys.readouterr().out, re.MULTILINE)):
            assert f'`{option}' in section, f'{command}: {option}'
            assert f'* `{option}' in section or f'* `{option}' in shared, f'{command}: {option} is not explained'


def test_keys_of_files_have_range_and_comment(generated):
    lines = [line.strip() for line in generated['vehicle_keys'].splitlines()]
    assert '* `capacity_ah`\\* 1…2000' in lines
    assert '* `soc_range`\\* 2 values 0…1: \\[low, high\\]; the low end is the reserve.' in lines


def test_every_topic_is_described():
    page = (ROOT / 'docs/reference/topics.md').read_text()
    for node in (
            'nodes.planner', 'nodes.nlp_checker', 'nodes.charger_adviser', 'nodes.route_publisher',
            'nodes.heater_controller', 'nodes.vehicle_simulator', 'nodes.bus_gateway', 'monitoring.dashboard'):
        program = import_module(f'bev_preheat.{node}_node').PROGRAM
        for name, _ in (*program.subscribes, *program.publishes, *program.services, *program.actions):
            assert f'`{name}`' in page, f'{program.name}: {name}'


def test_rules_of_the_heater_name_their_tests():
    page = (ROOT / 'docs/explanation/safety.md').read_text()
    rules = page.partition('## Requirements for the heater controller')[2]
    file = re.search(r'`(test/vehicle/\w+\.py)`', rules).group(1)
    rows = [row for row in cells(rules) if re.fullmatch(r'R\d.*|all', row[0])]
    assert [row[0][:2] for row in rows] == [f'R{number}' for number in range(1, 10)] + ['al']
    named = {name for row in rows for name in re.findall(r'test_\w+', row[-1])}
    assert all('test_' in row[-1] for row in rows)
    # Each test of the controller belongs to a rule, except the one on the message's numbers.
    assert named == set(re.findall(r'^def (test_\w+)', (ROOT / file).read_text(), re.MULTILINE)) - {
        'test_numbers_are_those_of_the_message'}


# --- citation ---


CITATION = yaml.safe_load((ROOT / 'CITATION.cff').read_text())


def test_the_citation_is_that_of_the_package():
    package = ElementTree.parse(ROOT / 'package.xml')
    assert CITATION['cff-version'] == '1.2.0' and CITATION['message']
    assert CITATION['title'] == package.findtext('name')
    # YAML reads 0.10 as a number; three parts are a text.
    assert CITATION['version'] == package.findtext('version')
    assert CITATION['license'] == package.findtext('license')
    assert CITATION['authors'] == [{'name': package.findtext('maintainer')}]


def test_the_paper_is_cited_as_on_its_page():
    paper, = CITATION['references']
    head = ' '.join((ROOT / 'docs/explanation/paper.md').read_text().split('\n\n')[1].split())
    authors = ', '.join(f'{author["given-names"][0]}. {author["family-names"]}' for author in paper['authors'])
    assert head == f'{authors}: *{paper["title"]}.*'


# --- versions of Python: each mention agrees with scripts/pythons.txt ---


PYTHONS = (ROOT / 'scripts' / 'pythons.txt').read_text().split()


def test_versions_rise_and_this_one_is_among_them():
    numbers = [tuple(map(int, version.split('.'))) for version in PYTHONS]
    assert sorted(numbers) == numbers
    assert numbers[0] <= sys.version_info[:2] <= numbers[-1]


@pytest.mark.parametrize('path, join', [
    ('README.md', 'or'), ('docs/how-to/ros_machine.md', 'or'), ('QUALITY_DECLARATION.md', 'and')])
def test_documents_name_these_versions(path, join):
    words = f'{", ".join(PYTHONS[:-1])} {join} {PYTHONS[-1]}'
    assert re.search(rf'Python,? {re.escape(words)}', (ROOT / path).read_text())


def test_types_are_checked_for_the_oldest():
    setup = configparser.ConfigParser()
    setup.read(ROOT / 'setup.cfg')
    assert setup['mypy']['python_version'] == PYTHONS[0]
