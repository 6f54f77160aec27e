# SPDX-License-Identifier: Apache-2.0
"""Files with the mistakes of an editor, a script or a worn-out disk."""

from copy import deepcopy
import re

NUMBER = re.compile(r'(?<![\w.])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?(?![\w.])')
VALUE = re.compile(r'(?<=[:,\[] )[^\n,\]}]+|(?<=,)[^\n,]+')
STRANGE = (
    '0', '-0.0', '-1', '6.0', '1e308', '-1e308', '1e-320', '.nan', '-.inf', 'nan', 'inf', '1' * 400,
    '-' + '9' * 5000, '0x' + 'f' * 5000, '0o17', '1_000', '1:30', '12,5', '1.2.3', '9' * 20, 'true',
    'null', '~', '""', "'7'", 'text', '[]', '{}', '[1, 2]', '[[1], [2, 3]]', '{a: 1}', '&x [*x]',
    '*unknown', '!!binary aGVsbG8=', '!!set {a}', '!!python/object:os.system x', '2024-01-01',
    '2024-13-45', '\u0664\u0662', '\u200b', 'Ω' * 700, '|', '>', '? a', '- ', '<<', '!!float abc',
    '!!int ""', '!!bool maybe', '!!timestamp soon', '!!omap [a: 1]')
SCALES = (-1, 0, 1e-9, 1e-3, 60, 1e3, 1e9, 1e200)
REPLACED = ((',', ';'), ('.', ','), ('0', ''), ('-', '--'), (':', ''), (' ', '\t'), ('1', 'l'),
            ('\n', '\r'), ('"', ''), ('_', ' '))


GONE = object()


def places(node, path=()):
    """Yield the path to each value in YAML or JSON; of long lists to the first few and the last."""
    pairs = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in pairs:
        if isinstance(node, list) and 3 < key < len(node) - 1:
            continue
        yield (*path, key)
        yield from places(value, (*path, key))


def changed(contents, place, value):
    """Return YAML or JSON with a value at a place, 'legs.0.route' or ('legs', 0, 'route'); GONE removes it."""
    node = made = deepcopy(contents)
    if isinstance(place, str):
        place = [int(key) if key.isdigit() else key for key in place.split('.')]
    *path, last = place
    for key in path:
        node = node[key]
    if value is GONE:
        del node[last]
    else:
        node[last] = value
    return made


def mutated(contents, random):
    """Return bytes with one to four mistakes; `random` is a random.Random."""
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        contents = random.choice(MISTAKES)(contents, random)
    return contents


def _of_text(change):
    return lambda contents, random: change(contents.decode('utf-8', 'surrogateescape'), random).encode(
        'utf-8', 'surrogateescape')


def _of_lines(change):
    def changed(text, random):
        lines = text.splitlines(keepends=True)
        if lines:
            change(lines, random)
        return ''.join(lines)
    return _of_text(changed)


def _of_matches(pattern, change):
    """Return a mistake that changes one match of a pattern: `change` takes its text and a random.Random."""
    def changed(text, random):
        found = list(pattern.finditer(text))
        if not found:
            return text
        at = random.choice(found)
        return text[:at.start()] + change(at[0], random) + text[at.end():]
    return _of_text(changed)


def _strange(_, random):
    return random.choice(STRANGE)


def _scaled(number, random):
    return f'{float(number) * random.choice(SCALES):g}'


def _misspelt(word, random):
    return random.choice((word[:-1], word + 'x', word.upper(), word[::-1], ''))


def _everywhere(text, random):
    """Corrupt one kind of text in all rows."""
    old, new = random.choice(REPLACED)
    return text.replace(old, new)


def _lose(lines, random):
    del lines[random.randrange(len(lines))]


def _repeat(lines, random):
    at = random.randrange(len(lines))
    lines[at:at] = lines[at:at + random.choice((1, 1, 5))] * random.choice((1, 2, 300))


def _swap(lines, random):
    one, other = random.randrange(len(lines)), random.randrange(len(lines))
    lines[one], lines[other] = lines[other], lines[one]


def _indent(lines, random):
    at = random.randrange(len(lines))
    lines[at] = random.choice(('  ', '\t', ' ')) + lines[at] if random.random() < 0.5 else lines[at].lstrip()


def _flip(contents, random):
    if not contents:
        return contents
    at = random.randrange(len(contents))
    return contents[:at] + bytes([random.randrange(256)]) + contents[at + 1:]


def _cut(contents, random):
    return contents[:random.randrange(len(contents) + 1)]


def _hole(contents, random):
    at = random.randrange(len(contents) + 1)
    return contents[:at] + contents[at + random.choice((1, 30, 300)):]


def _zeros(contents, random):
    at = random.randrange(len(contents) + 1)
    return contents[:at] + b'\0' * random.choice((1, 100))


MISTAKES = (
    *(_of_matches(NUMBER, _strange), _of_matches(VALUE, _strange)) * 2, _of_matches(NUMBER, _scaled),
    _of_matches(re.compile(r'\w{3,}'), _misspelt), _of_text(_everywhere),
    *map(_of_lines, (_lose, _repeat, _swap, _indent, lambda lines, random: random.shuffle(lines))), _flip, _cut,
    _hole, _zeros)
