# SPDX-License-Identifier: Apache-2.0
"""
Writes the parts of the docs that stand in the code already, as Markdown, into the pages of docs/.

    python docs/generated_reference.py --write

A page has a part between the lines `<!-- generated: NAME -->` and `<!-- end of NAME -->`. It is committed, so that
it can be read without a build; without --write, the pages that differ are named.
"""

import argparse
import ast
from collections import Counter
from pathlib import Path
import re
import sys

from diagnostic_msgs.msg import DiagnosticStatus
import yaml

from bev_preheat.commands.main import GROUPS, SUBCOMMANDS
from bev_preheat.commands.parser import make_parser
from bev_preheat.messages.diagnostics import HEATER_LEVELS, HEATER_SENTENCES
from bev_preheat.monitoring import dashboard_node
from bev_preheat.nodes import (
    bus_gateway_node,
    charger_adviser_node,
    heater_controller_node,
    nlp_checker_node,
    planner_node,
    route_publisher_node,
    vehicle_simulator_node,
)
from bev_preheat.planning.status import Status

ROOT = Path(__file__).resolve().parents[1]
NODES = (planner_node, nlp_checker_node, charger_adviser_node, route_publisher_node, heater_controller_node,
         vehicle_simulator_node, bus_gateway_node, dashboard_node)
SCHEMAS = {'signal_map': 'logs/signal_map_schema.yaml',
           'vehicle': 'vehicle/schema.yaml', 'legs': 'route/legs_schema.yaml',
           'chargers': 'charging/chargers_schema.yaml',
           'itinerary': 'control/itinerary_schema.yaml',
           'departures': 'control/departures_schema.yaml',
           'grid_prices': 'control/grid_prices_schema.yaml'}
LEVEL_NAMES = {DiagnosticStatus.OK: 'OK', DiagnosticStatus.WARN: 'WARN',
               DiagnosticStatus.ERROR: 'ERROR'}
STUDIES = 'bev_preheat_studies.'
# The mark of required arguments and keys, and of parameters that are read at the start only.
MARK = r'\*'
PART = re.compile(r'(<!-- generated: (\w+) -->\n)(?:.*?\n)?(<!-- end of \2 -->\n)', re.DOTALL)


def parts():
    """Return {name: text} of all generated parts."""
    return {'parameters': parameters(), 'statuses': statuses(),
            'heater': heater(), 'command_line': command_line(), 'files': files(),
            **{f'{name}_keys': schema_keys(ROOT / 'bev_preheat' / path) for name, path in SCHEMAS.items()}}


def filled_pages():
    """Return {path: text} of the pages that have generated parts, with these parts as they should be."""
    texts, pages = parts(), {}
    for path in (ROOT / 'bev_preheat' / 'README.md', *sorted((ROOT / 'docs').rglob('*.md'))):
        text = path.read_text(encoding='utf-8')
        if PART.search(text):
            pages[path] = PART.sub(lambda found: f'{found[1]}\n{texts[found[2]]}\n{found[3]}', text)
    return pages


def files():
    """Return the purpose of each file of product and studies: the first paragraph of its docstring."""
    folders = {}
    for path in sorted(path for top in ('bev_preheat', 'studies') for path in (ROOT / top).rglob('*.py')):
        if path.name != '__init__.py':
            purpose = ast.get_docstring(ast.parse(path.read_text(encoding='utf-8'))).partition('\n\n')[0]
            folders.setdefault(path.parent.relative_to(ROOT).as_posix(), []).append(
                f'* `{path.name}`: {" ".join(purpose.split())}')
    return '\n\n'.join('\n'.join([f'## {folder}', '', *rows]) for folder, rows in folders.items())


def main():
    """Write the pages, or name those that differ; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--write', action='store_true', help='write the pages')
    write = parser.parse_args().write
    differing = [path for path, text in filled_pages().items() if path.read_text(encoding='utf-8') != text]
    for path in differing:
        if write:
            path.write_text(filled_pages()[path], encoding='utf-8')
        print(f'{path.relative_to(ROOT)}: {"written" if write else "differs; run with --write"}')
    return 1 if differing and not write else 0


# --- Markdown ---


def table(header, rows):
    """Return a table whose cells are Markdown already."""
    def line(cells):
        return f'| {" | ".join(cell.replace("|", chr(92) + "|") for cell in cells)} |'

    return '\n'.join([line(header), '|' + '---|' * len(header), *map(line, rows)]) + '\n'


def code(text):
    """Return a text as code."""
    return f'`{text}`' if text else ''


def plain(text):
    """Return a text in which Markdown sees no markup."""
    return re.sub(r'([\\`*_<>\[\]#])', r'\\\1', text)


def page(*parts):
    """Return the parts, an empty line between them."""
    return '\n\n'.join(part.strip('\n') for part in parts if part) + '\n'


def with_shared(title, sections):
    """
    Return the text of sections: heading, introduction, and rows of name, text, mark.

    What several sections say alike of a name stands once, first.
    """
    number_of = Counter(row[:2] for *_, rows in sections for row in rows)
    # Of names with several meanings the most frequent one, so that a name without a meaning has one.
    most_frequent = {name.split()[0]: (name, text) for (name, text), _ in reversed(number_of.most_common())}
    shared = [row for row, number in number_of.items() if number > 1 and row in most_frequent.values()]
    parts = [f'## {title}', '\n'.join(f'* {code(name)}{text}' for name, text in shared)]
    for heading, introduction, rows in sections:
        names = [code(row[0].split()[0]) + row[2] for row in rows if row[:2] in shared]
        parts += [f'## {heading}', introduction, f'Shared: {", ".join(names)}.' if names else '',
                  '\n'.join(f'* {code(name)}{mark}{text}' for name, text, mark in rows
                            if (name, text) not in shared)]
    return page(*parts)


# --- Parameters, statuses ---


def parameters():
    """Return the parameters of the nodes; those that are read at the start only have the mark."""
    return with_shared('Shared parameters', [
        (f'Parameters of `{node.PROGRAM.name}`', '', list(map(parameter_row, node.PROGRAM.parameters)))
        for node in NODES])


def parameter_row(parameter):
    """Return name, default with allowed values and meaning, and mark of a parameter."""
    default = '' if parameter.default == '' else f' = {parameter.default_text()}'
    values = allowed(parameter)
    return (parameter.name, plain(default) + (f' ({values})' if values else '')
            + f': {plain(parameter.description.rstrip("."))}', MARK if parameter.read_only else '')


def allowed(parameter):
    """Return the allowed values of a parameter, '' for any text or truth value."""
    if parameter.choices:
        return ', '.join(map(plain, parameter.choices))
    if isinstance(parameter.default, bool) or not parameter.limits:
        return ''
    low, high = parameter.limits
    unit = f' {parameter.unit}' if parameter.unit else ''
    unset = f'; 0 or NaN: {parameter.unset_means}' if parameter.unset_means else ''
    return (f'{low:g}…{high:g}{unit}' + unset).replace('e+0', 'e')


def statuses():
    """Return the table of the statuses: number, name, meaning, level in /diagnostics."""
    text = (ROOT / 'msg_defs/msg/HvchCommand.msg').read_text()
    meanings = dict(re.findall(r'^uint8 (\w+)=\d+ +# (.*)$', text, re.MULTILINE))
    return table(('number', 'status', 'meaning', 'diagnostics'),
                 [(str(int(status)), code(status.name), plain(meanings[status.name]),
                   status.meaning.level.name) for status in Status])


def heater():
    """Return the table of what `planner: heater` says."""
    return table(('heater', 'level', 'meaning'),
                 [(code(answer.value), LEVEL_NAMES[level],
                   plain(HEATER_SENTENCES[answer].replace('{share:.0f} %', '10 … 90 %')))
                  for answer, level in HEATER_LEVELS.items()])


# --- Files ---


def schema_keys(path):
    """Return the keys that a YAML schema allows as nested lists; comments in it are the meanings."""
    text = path.read_text()
    schema, comments = yaml.safe_load(text), key_comments(text)
    lines = list(key_lines(path, schema, comments, schema, ()))
    for name, node in schema.get('definitions', {}).items():
        # What several keys refer to is described once.
        place = ('definitions', name)
        below = list(key_lines(path, schema, comments, *contents(schema, node, place), 1))
        if below:
            lines += [key_line(0, [f'*{name}*'], value_text(node, schema), comments.get(place, '')), *below]
    return '\n'.join(lines) + '\n'


def contents(schema, node, place):
    """Return the node whose keys stand below a key, and its place: of an item, or of a name of one's own."""
    if 'properties' in node:
        return node, place
    if isinstance(named := node.get('additionalProperties'), dict):
        return named, (*place, 'additionalProperties')
    if 'items' in node:
        return resolve(schema, node['items'], (*place, 'items'))
    return node, place


def key_lines(path, schema, comments, node, keys, depth=0):
    """
    Yield a line for each key below a node of the schema, indented; `keys` lead to it in the file.

    A key may refer to the schema of another file, seen from the folder of this one's `path`. Neighbours of one
    kind without a meaning of their own share a line.
    """
    shared, shared_kind = [], None
    for key, value in node.get('properties', {}).items():
        place = (*keys, 'properties', key)
        name = code(key) + (MARK if key in node.get('required', ()) else '')
        said, kind, below = comments.get(place, ''), '', []
        if str(value.get('$ref', '#')).endswith('.yaml'):
            text = (path.parent / value['$ref']).read_text()
            other = yaml.safe_load(text)
            below = list(key_lines(path, other, key_comments(text), other, (), depth + 1))
        else:
            resolved, resolved_place = resolve(schema, value, place)
            inner, inner_place = contents(schema, resolved, resolved_place)
            shared_place = inner_place if inner_place[0] == 'definitions' else resolved_place
            if shared_place != place and 'properties' in inner:
                # Described once, at the end.
                kind = ('list of ' if shared_place[:2] != resolved_place[:2] else '') + f'*{shared_place[1]}*'
            else:
                said = said or comments.get(resolved_place, '')
                kind = value_text(resolved, schema)
                below = list(key_lines(path, schema, comments, inner, inner_place, depth + 1))
        if said or below or kind != shared_kind:
            if shared:
                yield key_line(depth, shared, shared_kind)
            shared, shared_kind = [], None
        if said or below:
            yield key_line(depth, [name], kind, said)
            yield from below
        else:
            shared, shared_kind = [*shared, name], kind
    if shared:
        yield key_line(depth, shared, shared_kind)


def key_line(depth, names, kind, said=''):
    """Return the line of keys of one kind."""
    meaning = '' if not said else ('. ' if said.startswith(('Missing:', 'Default:')) else ': ') + plain(said)
    return f'{"  " * depth}* {", ".join(names)}' + (f' {kind}' if kind else '') + meaning


def resolve(schema, node, place):
    """Return the target of a node's reference and its place; without a reference the node itself."""
    if isinstance(node, dict) and '$ref' in node:
        place = tuple(node['$ref'].removeprefix('#/').split('/'))
        for key in place:
            schema = schema[key]
        return schema, place
    return node, place


def value_text(node, schema):
    """Return type and range of a value in words; '' of one with keys below it."""
    if 'enum' in node:
        return ', '.join(str(value) for value in node['enum'])
    kinds = node.get('type', 'object')
    texts = []
    for kind in kinds if isinstance(kinds, list) else [kinds]:
        if kind == 'array':
            texts.append(list_text(node, schema))
        elif kind in ('number', 'integer'):
            span = range_text(node)
            texts.append(span if span and kind == 'number' else f'{kind} {span}'.strip())
        elif kind != 'object':
            texts.append({'string': 'text', 'boolean': 'true, false'}.get(kind, kind))
    return ' or '.join(texts)


def list_text(node, schema):
    """Return the allowed contents of a list."""
    items, _ = resolve(schema, node.get('items', {}), ())
    least, most = node.get('minItems'), node.get('maxItems')
    count = f'{least} ' if least is not None and least == most else ''
    limits = '' if count or most is None else f' (at most {most})'
    if items.get('properties') or items.get('type') == 'object':
        return f'list{limits}'
    if items.get('type') == 'array':
        return 'list of [from, to]'
    text = re.sub('^(number|integer)', r'\1s', value_text(items, schema)) if items else 'numbers'
    if count and text[0] not in 'ni':
        count += 'values '
    return f'{count or "list of "}{text.replace(" or list of", " or lists of")}{limits}'


def range_text(node):
    """Return the range of a number, '' without one."""
    low, high = node.get('minimum'), node.get('maximum')
    above, below = node.get('exclusiveMinimum'), node.get('exclusiveMaximum')
    start = f'>{above:.10g}' if above is not None else '' if low is None else f'{low:.10g}'
    end = f'<{below:.10g}' if below is not None else '' if high is None else f'{high:.10g}'
    if start and end:
        return f'{start}…{end}'
    return start if above is not None else f'≥{start}' if start else f'≤{end}' if end and below is None else end


def key_comments(text):
    """Return {keys that lead to a value: the comment lines right above it} of a YAML text."""
    lines = text.splitlines()
    comments = {}

    def walk(node, keys):
        if not isinstance(node, yaml.MappingNode):
            return
        for key, value in node.value:
            place = (*keys, key.value)
            number, said = key.start_mark.line - 1, []
            while number >= 0 and lines[number].lstrip().startswith('# '):
                said.insert(0, lines[number].strip().removeprefix('# '))
                number -= 1
            if said and 'SPDX' not in said[0]:
                comments[place] = ' '.join(said)
            walk(value, place)

    walk(yaml.compose(text), ())
    return comments


# --- Command line ---


def command_line():
    """Return the subcommands of `preheat` without the studies, with their options; shared options come first."""
    described = {name: module for name, module in SUBCOMMANDS.items() if not module.startswith(STUDIES)}
    return with_shared('Shared options', [
        (f'`{parser.prog}`', plain((parser.description or '') % {'prog': parser.prog}), list(option_rows(parser)))
        for parser in parsers_below(make_parser(described, GROUPS))])


def parsers_below(parser):
    """Yield the parsers of the subcommands of a parser, and of those below them."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield below
                yield from parsers_below(below)


def option_rows(parser):
    """Yield name and value, meaning, and mark (required) of each option and argument of a parser."""
    formatter = parser._get_formatter()
    # In the order of the help: the common ones, then those of groups.
    shown = dict.fromkeys(action for group in parser._action_groups for action in group._group_actions)
    for action in shown:
        if isinstance(action, (argparse._HelpAction, argparse._SubParsersAction)):
            continue
        value = '' if action.nargs == 0 else action.metavar or '|'.join(action.choices or [action.dest.upper()])
        name = ' '.join(filter(None, [', '.join(action.option_strings), value]))
        yield (name, f': {plain(formatter._expand_help(action))}' if action.help else '',
               MARK if action.required and action.nargs not in ('*', '?') else '')


if __name__ == '__main__':
    sys.exit(main())
