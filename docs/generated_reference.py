# SPDX-License-Identifier: Apache-2.0
"""
Writes the parts of the docs that stand in the code already, as Markdown, into the pages of docs/.

    python docs/generated_reference.py --write

A page has a part between the lines `<!-- generated: NAME -->` and `<!-- end of NAME -->`. It is committed, so that
it can be read without a build; without --write, the pages that differ are named.
"""

import argparse
from pathlib import Path
import re
import sys

from diagnostic_msgs.msg import DiagnosticStatus
import yaml

from bev_preheat.commands.arguments import make_parser
from bev_preheat.commands.main import GROUPS, SUBCOMMANDS
from bev_preheat.dashboard import dashboard_node
from bev_preheat.nodes import (
    bus_gateway_node,
    charger_adviser_node,
    heater_controller_node,
    nlp_checker_node,
    planner_node,
    route_publisher_node,
    vehicle_simulator_node,
)
from bev_preheat.nodes.diagnostics import HEATER_LEVELS, HEATER_SENTENCES
from bev_preheat.planning.status import Status

ROOT = Path(__file__).resolve().parents[1]
MESSAGES = ('RoutePlan', 'RouteProgress', 'HvchCommand', 'HvchStatus', 'PreheatPlan', 'OptimalityReport')
ACTIONS = ('PrepareBattery',)
SERVICES = ('RankChargers',)
SERVICE_PARTS = ('Request', 'Response')
ACTION_PARTS = ('Goal', 'Result', 'Feedback')
NODES = (planner_node, nlp_checker_node, charger_adviser_node, route_publisher_node, heater_controller_node,
         vehicle_simulator_node, bus_gateway_node, dashboard_node)
SCHEMAS = {'vehicle': 'vehicle/schema.yaml', 'legs': 'route/legs_schema.yaml',
           'chargers': 'charging/chargers_schema.yaml',
           'itinerary': 'control/itinerary_schema.yaml',
           'departures': 'control/departures_schema.yaml',
           'grid_prices': 'control/grid_prices_schema.yaml',
           'scenario': 'simulation/scenario_schema.yaml'}
# Files that a page shows, with their language.
EXAMPLES = {'example_map': ('yaml', 'config/signals/example_car.yaml'),
            'example_method': ('python', 'docs/examples/fixed_minutes_method/fixed_minutes_method.py'),
            'example_project': ('toml', 'docs/examples/fixed_minutes_method/pyproject.toml')}
LEVEL_NAMES = {DiagnosticStatus.OK: 'OK', DiagnosticStatus.WARN: 'WARN',
               DiagnosticStatus.ERROR: 'ERROR'}
INDENT = 3 * '&nbsp;'
# A unit stands in square brackets in the comment of a field.
UNIT = re.compile(r' ?\[(deg C|K|s|m|m/s|W|Wh)\]')


PART = re.compile(r'(<!-- generated: (\w+) -->\n)(?:.*?\n)?(<!-- end of \2 -->\n)', re.DOTALL)


def parts():
    """Return {name: text} of all generated parts."""
    return {'messages': messages(), 'parameters': parameters(), 'statuses': statuses(),
            'heater': heater(), 'command_line': command_line(),
            **{f'{name}_keys': schema_keys(ROOT / 'bev_preheat' / path)
               for name, path in SCHEMAS.items()},
            'live_keys': schema_keys(ROOT / 'bev_preheat/logs/signal_map_schema.yaml', ('properties', 'live'),
                                     ('checksum', 'can')),
            **{name: f'```{language}\n{(ROOT / path).read_text()}```\n'
               for name, (language, path) in EXAMPLES.items()}}


def filled_pages():
    """Return {path: text} of the pages that have generated parts, with these parts as they should be."""
    texts, pages = parts(), {}
    for path in sorted((ROOT / 'docs').rglob('*.md')):
        text = path.read_text(encoding='utf-8')
        if PART.search(text):
            pages[path] = PART.sub(lambda found: f'{found[1]}\n{texts[found[2]]}\n{found[3]}', text)
    return pages


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


# --- Messages ---


def messages():
    """Return each message, action and service: its comment, constants and fields."""
    return page(*(message(f'## {name}', (ROOT / f'msg_defs/msg/{name}.msg').read_text())
                  for name in MESSAGES), *map(action, ACTIONS), *map(service, SERVICES))


def action(name):
    """Return the section of one action: a message each for goal, result and feedback."""
    texts = (ROOT / f'msg_defs/action/{name}.action').read_text().split('\n---\n')
    return page(f'## {name}', *(message(f'### {part} of {name}', text)
                                for part, text in zip(ACTION_PARTS, texts, strict=True)))


def service(name):
    """Return the section of one service: a message each for request and response."""
    texts = (ROOT / f'msg_defs/srv/{name}.srv').read_text().split('\n---\n')
    return page(f'## {name}', *(message(f'### {part} of {name}', text)
                                for part, text in zip(SERVICE_PARTS, texts, strict=True)))


def message(heading, text):
    """Return the section of one message from the text of its .msg file."""
    parts, rows, said_before = [heading], [], ''
    for kind, comment, definitions in blocks(text):
        if rows and kind != rows[0][0]:
            parts.append(_table_of(rows))
            rows = []
        if kind == 'field':
            rows.append((kind, field_row(comment, definitions, said_before)))
            continue
        said_before = comment
        parts.append(plain(comment))
        if kind == 'constants' and not any(remark for _, remark in definitions):
            parts.append(', '.join(f'{value} {code(constant)}' for constant, value in map(
                _constant, definitions)))
        else:
            rows += [(kind, (value, code(constant), plain(remark)))
                     for (constant, value), (_, remark) in zip(
                         map(_constant, definitions), definitions, strict=True)]
    return page(*parts, _table_of(rows))


def blocks(text):
    """
    Yield (kind, comment, definitions) from the text of a .msg file.

    A comment with an empty line behind it is a 'paragraph'; one right above definitions belongs to
    all definitions up to the next comment, which are 'constants' or a 'field'.
    """
    comment, definitions = [], []

    def block():
        kind = ('paragraph' if not definitions else
                'constants' if '=' in definitions[0][0] else 'field')
        return kind, ' '.join(comment), tuple(definitions)

    for line in [*text.splitlines(), '']:
        definition, _, remark = (part.strip() for part in line.partition('#'))
        if definition:
            is_constant = '=' in definition
            if definitions and is_constant is not ('=' in definitions[0][0]):
                yield block()
                comment, definitions = [], []
            definitions.append((definition, remark))
        else:
            ends = bool(definitions) or not line or not remark
            if ends and (comment or definitions):
                yield block()
                comment, definitions = [], []
            if remark:
                comment.append(remark)


def field_row(comment, definitions, said_before):
    """Return the row of the fields that share a comment; a unit may be that of the paragraph before."""
    kinds, names = zip(*(definition.split() for definition, _ in definitions), strict=True)
    units = UNIT.findall(comment)
    if len(units) == 1:
        comment = UNIT.sub('', comment)
    elif not units and comment and len(UNIT.findall(said_before)) == 1:
        units = UNIT.findall(said_before)
    return ('<br>'.join(map(code, names)), '<br>'.join(map(code, kinds)),
            units[0].replace('deg C', '°C') if len(units) == 1 else '', plain(comment) or 'as said above')


def _constant(definition):
    name, _, value = definition[0].partition(' ')[2].partition('=')
    return name.strip(), value.strip()


def _table_of(rows):
    if not rows:
        return ''
    header = (('field', 'type', 'unit', 'meaning') if rows[0][0] == 'field'
              else ('value', 'constant', 'meaning'))
    return table(header, [row for _, row in rows])


# --- Parameters, statuses ---


def parameters():
    """Return the parameters of the three nodes."""
    return page(*(part for node in NODES for part in (
        f'## Parameters of `{node.PROGRAM.name}`',
        table(('name', 'default', 'allowed', 'meaning', 'at run time'),
              [(code(parameter.name),
                'empty' if parameter.default == '' else code(parameter.default_text()),
                allowed(parameter), plain(parameter.description.rstrip('.')),
                'no' if parameter.read_only else 'yes')
               for parameter in node.PARAMETERS]))))


def allowed(parameter):
    """Return the allowed values of a parameter."""
    if parameter.choices:
        return ', '.join(map(code, parameter.choices))
    if isinstance(parameter.default, bool):
        return '`true`, `false`'
    if not parameter.limits:
        return 'text'
    low, high = parameter.limits
    unit = f' {parameter.unit}' if parameter.unit else ''
    unset = f'; 0 or NaN: {parameter.unset_means}' if parameter.unset_means else ''
    return (f'{low:g} … {high:g}{unit}'.replace(' ', '\N{NO-BREAK SPACE}') + unset).replace('e+0', 'e')


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


def schema_keys(path, begins=(), definitions=None):
    """
    Return the table of the keys that a YAML schema allows; comments in it are the meanings.

    `begins` leads to the node whose keys are listed; `definitions` are the shared ones to list (None: all).
    """
    text = path.read_text()
    schema, comments = yaml.safe_load(text), key_comments(text)
    node = schema
    for key in begins:
        node = node[key]
    rows = list(key_rows(path, schema, comments, node, begins))
    for name, node in schema.get('definitions', {}).items():
        if definitions is not None and name not in definitions:
            continue
        # What several keys refer to is described once.
        below = list(key_rows(path, schema, comments, node, ('definitions', name), 1))
        rows += [(f'a {name}:', '', '', ''), *below] if below else []
    return table(('key', 'type and range', 'needed', 'meaning'), rows)


def key_rows(path, schema, comments, node, keys, depth=0, mark=''):
    """
    Yield the rows of the keys below a node of the schema, indented; `keys` lead to it in the file.

    A key may refer to the schema of another file, seen from the folder of this one's `path`. `mark`
    stands before the first row.
    """
    for key, value in node.get('properties', {}).items():
        place = (*keys, 'properties', key)
        if str(value.get('$ref', '#')).endswith('.yaml'):
            yield (INDENT * depth + mark + code(key), 'keys',
                   'yes' if key in node.get('required', ()) else '', plain(comments.get(place, '')))
            text = (path.parent / value['$ref']).read_text()
            other = yaml.safe_load(text)
            yield from key_rows(path, other, key_comments(text), other, (), depth + 1)
            continue
        resolved, resolved_place = resolve(schema, value, place)
        # Keys that older files may have, and that are refused with advice.
        if 'not' in resolved:
            continue
        is_shared = resolved_place != place and 'properties' in resolved
        said = comments.get(place) or ('' if is_shared else comments.get(resolved_place, ''))
        kind = resolved_place[-1] if is_shared else value_text(resolved, schema)
        yield (INDENT * depth + mark + code(key), kind,
               'yes' if key in node.get('required', ()) else '', plain(said))
        # The keys of one item begin below each other.
        mark = '&nbsp;&nbsp;' if mark else ''
        if is_shared:
            continue
        yield from key_rows(path, schema, comments, resolved, resolved_place, depth + 1)
        if isinstance(named := resolved.get('additionalProperties'), dict) and 'properties' in named:
            yield INDENT * (depth + 1) + 'each name', 'keys', '', ''
            named_place = (*resolved_place, 'additionalProperties')
            yield from key_rows(path, schema, comments, named, named_place, depth + 2)
        items, items_place = resolve(schema, resolved.get('items', {}), (*resolved_place, 'items'))
        yield from key_rows(path, schema, comments, items, items_place, depth + 1, '-&nbsp;')


def resolve(schema, node, place):
    """Return the target of a node's reference and its place; without a reference the node itself."""
    if isinstance(node, dict) and '$ref' in node:
        place = tuple(node['$ref'].removeprefix('#/').split('/'))
        for key in place:
            schema = schema[key]
        return schema, place
    return node, place


def value_text(node, schema):
    """Return type and range of a value in words."""
    if 'enum' in node:
        return ', '.join(map(code, node['enum']))
    kinds = node.get('type', 'object')
    kinds = kinds if isinstance(kinds, list) else [kinds]
    texts = []
    for kind in kinds:
        if kind == 'array':
            texts.append(list_text(node, schema))
        elif kind in ('number', 'integer'):
            texts.append(' '.join(filter(None, ['whole number' if kind == 'integer' else 'number',
                                                range_text(node)])))
        elif kind == 'object':
            texts.append('keys')
        else:
            texts.append({'string': 'text', 'boolean': '`true`, `false`'}.get(kind, kind))
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
    text = re.sub('^number', 'numbers', value_text(items, schema)) if items else 'numbers'
    return f'list of {count}{text.replace("list of number", "lists of number")}{limits}'


def range_text(node):
    """Return the range of a number, '' without one."""
    low, high = node.get('minimum'), node.get('maximum')
    above, below = node.get('exclusiveMinimum'), node.get('exclusiveMaximum')
    start = f'above {above:.10g}' if above is not None else '' if low is None else f'{low:.10g}'
    end = '' if high is None else f'{high:.10g}'
    if below is not None:
        end = f'below {below:.10g}'
    if above is not None and end:
        return f'{start}, at most {end}'
    if start and end:
        return f'{start}\N{NO-BREAK SPACE}…\N{NO-BREAK SPACE}{end}'
    return start if above is not None else f'at least {start}' if start else end


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
    """Return all subcommands of `preheat` with their options."""
    return page(*command_parts(make_parser(SUBCOMMANDS, GROUPS)))


def command_parts(parser):
    """Yield the sections of the subcommands of a parser, those below them too."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield f'## `{below.prog}`'
                yield plain(below.description or '')
                rows = list(option_rows(below))
                yield table(('option', 'value', 'needed', 'meaning'), rows) if rows else ''
                yield from command_parts(below)


def option_rows(parser):
    """Yield a row for each option and argument of a parser."""
    formatter = parser._get_formatter()
    # In the order of the help: the common ones, then those of groups.
    shown = dict.fromkeys(action for group in parser._action_groups for action in group._group_actions)
    for action in shown:
        if isinstance(action, (argparse._HelpAction, argparse._SubParsersAction)):
            continue
        value = '' if action.nargs == 0 else (
            ', '.join(map(code, action.choices)) if action.choices
            else code(action.metavar or action.dest.upper()))
        name = ', '.join(map(code, action.option_strings)) or 'argument'
        needed = action.required and action.nargs not in ('*', '?')
        yield (name, value, 'yes' if needed else '',
               plain(formatter._expand_help(action) if action.help else ''))


if __name__ == '__main__':
    sys.exit(main())
