# SPDX-License-Identifier: Apache-2.0
"""Damaged copies of a file: truncated, swapped, repeated, overwritten, with wild numbers; seeded."""

WILD = (b'', b'nan', b'1e999', b'-', b'"', b';', b',', b'\n', b'\r', b'\0', b'\xff\xfe', b'9' * 400, b'-40',
        b'65535', b'1e308', b'{', b'}',
        b'[' * 3000, b'0x10', b'\xe2\x80\xaf', b'none', b'2024-13-45T99:99:99', b'#')


def mutated(data, random):
    """Return a damaged copy of bytes, by one to four operations of a random.Random."""
    data = bytearray(data)
    for _ in range(random.randint(1, 4)):
        if not data:
            break
        at, other = sorted(random.randrange(len(data) + 1) for _ in range(2))
        kind = random.randrange(8)
        if kind == 0:
            del data[at:]
        elif kind == 1:
            del data[at:min(other, at + 300)]
        elif kind == 2:
            data[at:at] = data[at:other][:2000]
        elif kind == 3:
            data[at:at + random.randint(0, 8)] = random.choice(WILD)
        elif kind == 4:
            for _ in range(random.randint(1, 30)):
                data[random.randrange(len(data))] = random.randrange(256)
        elif kind == 5:
            rows = bytes(data).split(b'\n')
            random.shuffle(rows)
            data = bytearray(b'\n'.join(rows))
        elif kind == 6:
            old, new = (random.choice(b',;\t.|"0123456789') for _ in range(2))
            data = data.replace(bytes([old]), bytes([new]), random.choice((-1, 1, 20)))
        else:
            data[:at] = b''
    return bytes(data)
