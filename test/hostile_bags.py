"""Bags as somebody who means harm, or a broken disk, would make them, all from one good bag."""

import functools
import json
import math
import os
import random
import struct
import zlib
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import lz4.frame
import zstandard
from assembly import simulated
from mcap.reader import make_reader
from mcap.writer import Writer

from parallel_robot.bags.writing import bag_writer, simulation_bag
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import layouts, topics

MAGIC = b'\x89MCAP0\r\n'
HUGE = 2**63
ESCAPE = '\x1b]0;owned\x07\x1b[2J\r\nroot@host:~# '
LONG = 10_000_000  # characters
ZEROS = 5 * 2**30  # bytes of a bomb
LIE = 2**28  # bytes, the most that a chunk may unpack to
JOINTS = ('joint1', 'joint2', 'joint3')


class Good(NamedTuple):
    """A bag of `simulate`."""

    data: bytes
    facts: dict[str, str]
    messages: list[tuple[str, int, bytes]]  # topic without slash, time, payload


def make(bag: Path) -> Good:
    """A good bag of many small chunks, to be made hostile."""
    values = config.resolve('paper_circle', {'duration': 0.06, 'time_mode': 'lockstep'})
    size, bag_writer.CHUNK_SIZE = bag_writer.CHUNK_SIZE, 8000
    try:
        simulation_bag.write(bag, values, [simulated(values)])
    finally:
        bag_writer.CHUNK_SIZE = size
    return read(bag)


def read(bag: Path) -> Good:
    path = next(bag.glob('*.mcap'))
    with path.open('rb') as stream:
        reader = make_reader(stream)
        facts = next(m for m in reader.iter_metadata() if m.name == 'parallel_robot').metadata
        messages = [(c.topic[1:], m.log_time, m.data) for _, c, m in reader.iter_messages()]
    return Good(path.read_bytes(), facts, messages)


# MCAP by hand


def text(value):
    value = value if isinstance(value, bytes) else value.encode()
    return struct.pack('<I', len(value)) + value


def texts(values):
    body = b''.join(text(key) + text(value) for key, value in values.items())
    return struct.pack('<I', len(body)) + body


def record(opcode, body, length=None):
    return struct.pack('<BQ', opcode, len(body) if length is None else length) + body


def header():
    return record(1, text('ros2') + text('by hand'))


def schema(number, name, definition=b''):
    body = struct.pack('<H', number) + text(name) + text('ros2msg')
    return record(3, body + text(definition))


def channel(number, topic, schema_number, encoding='cdr', metadata=None):
    body = struct.pack('<HH', number, schema_number) + text(topic) + text(encoding)
    return record(4, body + texts(metadata or {}))


def message(channel_number, time, payload):
    return record(5, struct.pack('<HIQQ', channel_number, 0, time, time) + payload)


def chunk(content, packed=None, compression='', size=None, crc=0):
    packed = content if packed is None else packed
    size = len(content) if size is None else size
    body = struct.pack('<QQQI', 0, 2**40, size, crc) + text(compression)
    return record(6, body + struct.pack('<Q', len(packed)) + packed)


def zstd_chunk(content, **lies):
    packed = zstandard.ZstdCompressor().compress(content)
    return chunk(content, packed, 'zstd', **lies)


def attachment(name, data=b'x'):
    body = struct.pack('<QQ', 0, 0) + text(name) + text('text/plain')
    body += struct.pack('<Q', len(data)) + data
    return record(9, body + struct.pack('<I', zlib.crc32(body)))


def metadata(name, values):
    return record(12, text(name) + texts(values))


def end(summary=b'', start=0, offsets=0):
    return record(15, bytes(4)) + summary + record(2, struct.pack('<QQI', start, offsets, 0))


def statistics(count):
    return record(11, struct.pack('<QHIIIIQQI', count, 1, 1, 0, 0, 1, 0, 2**40, 0))


def chunk_index(offset, length, first=0, last=2**40):
    return record(8, struct.pack('<QQQQ', first, last, offset, length) + struct.pack('<IQ', 0, 0)
                  + text('') + struct.pack('<QQ', 0, 0))  # fmt: skip


def by_hand(*records, indexed=True):
    """A file with a true index of its chunks."""
    data = MAGIC + header()
    indexes, described = b'', b''
    for each in records:
        if each[:1] == b'\x06':
            indexes += chunk_index(len(data), len(each))
        elif each[:1] in b'\x03\x04':
            described += each
        data += each
    if not indexed:
        return data + end() + MAGIC
    start = len(data) + len(record(15, bytes(4)))
    return data + end(described + statistics(len(indexes)) + indexes, start) + MAGIC


CHANNELS = {topic.name: (number, topic) for number, topic in enumerate(topics.RECORDED, start=1)}


def described():
    return b''.join(
        schema(number, topic.type) + channel(number, f'/{name}', number)
        for name, (number, topic) in CHANNELS.items()
    )


def content(good, count=None):
    """Messages as records of a chunk."""
    return b''.join(
        message(CHANNELS[name][0], time, payload) for name, time, payload in good.messages[:count]
    )


# Bags like the good one, but for something


def bag(good, facts=None, messages=None, notes=(), attachments=(), space='', **options):
    """A whole bag of mcap's writer."""
    stream = BytesIO()
    writer = Writer(stream, **options)
    writer.start('ros2')
    facts = good.facts if facts is None else facts
    if facts:
        writer.add_metadata('parallel_robot', facts)
    for name, values in notes:
        writer.add_metadata(name, values)
    for name, data in attachments:
        writer.add_attachment(0, 0, name, 'text/plain', data)
    known = {topic.name: topic.type for topic in topics.RECORDED}
    numbers = {}
    for name, time, payload in good.messages if messages is None else messages:
        if name not in numbers:
            number = writer.register_schema(known.get(name, 'std_msgs/msg/String'), 'ros2msg', b'')
            numbers[name] = writer.register_channel(f'{space}/{name}', 'cdr', number)
        writer.add_message(numbers[name], time, payload, time)
    writer.finish()
    return stream.getvalue()


def configured(good, **changes):
    """With another configuration."""
    values = json.loads(good.facts['config']) | changes
    return bag(good, {**good.facts, 'config': json.dumps(values)})


STATE = layouts.joint_state((*JOINTS, *(f'{joint}_passive' for joint in JOINTS)))
LAYOUTS = {
    'joint_states': STATE,
    'reference': layouts.joint_trajectory(JOINTS),
    'effort_controller/commands': layouts.float64_multi_array(3),
}


def edited(good, name, edit, layout=None):
    """With other messages on a topic: `edit` gets a record and its index, and changes it."""
    messages, k = [], 0
    for topic, time, payload in good.messages:
        if topic == name:
            found = LAYOUTS[name].decode(payload)
            changed = (layout or LAYOUTS[name]).records(1)
            for key in changed.dtype.names:
                if changed[key].shape == found[key].shape:
                    changed[key] = found[key]
            edit(changed, k)
            payload, k = changed.tobytes(), k + 1
        messages.append((topic, time, payload))
    return bag(good, messages=messages)


def field(name, value, every=1):
    def edit(found, k):
        if k % every == 0:
            found[name] = value

    return edit


def stamps(stamp):
    def edit(found, k):
        found['sec'], found['nanosec'] = stamp(k)

    return edit


def joints(good, names, configured_too=True):
    """A robot of other joints."""
    other = layouts.joint_state(names)
    messages = [
        (name, time, {
            'joint_states': other.encode(time),
            'reference': layouts.joint_trajectory(names).encode(time),
            'effort_controller/commands': layouts.float64_multi_array(len(names)).encode(),
        }.get(name, payload))
        for name, time, payload in good.messages
    ]  # fmt: skip
    values = json.loads(good.facts['config']) | {'joints': list(names)}
    facts = {**good.facts, 'config': json.dumps(values)} if configured_too else None
    return bag(good, facts, messages)


def renamed(good, names):
    """The same motion of joints with other names."""
    other = {
        'joint_states': layouts.joint_state(names),
        'reference': layouts.joint_trajectory(names),
    }
    messages = []
    for name, time, payload in good.messages:
        if name in other:
            found = LAYOUTS[name].decode(payload)
            values = {key: found[key][0, :3] for key in found.dtype.names[2:]}
            payload = other[name].encode(time, **values)
        messages.append((name, time, payload))
    values = json.loads(good.facts['config']) | {'joints': list(names)}
    return bag(good, {**good.facts, 'config': json.dumps(values)}, messages)


def with_facts(good, **facts):
    return bag(good, {**good.facts, **facts})


def with_config(good, config):
    return with_facts(good, config=config)


def zeros(size, said=None):
    """A zstd frame that unpacks to zeros, four bytes for 128 KiB."""
    head = b'\x28\xb5\x2f\xfd' + (
        b'\x00\x38' if said is None else b'\xc0\x38' + struct.pack('<Q', said)
    )
    block = 1 << 17
    blocks = [(1 << 1 | block << 3).to_bytes(3, 'little') + b'\0'] * (size // block)
    blocks[-1] = (1 | 1 << 1 | block << 3).to_bytes(3, 'little') + b'\0'
    return head + b''.join(blocks)


def bomb(good, copies, pack):
    """Chunks of nothing but one message, again and again."""
    one = next(p for name, _, p in good.messages if name == 'joint_states')
    inside = described() + message(1, 10**9, one) * (LIE // 2 // (len(one) + 31))
    packed = pack(inside)
    name = 'zstd' if pack is not lz4.frame.compress else 'lz4'
    return by_hand(described(), content(good), *[chunk(inside, packed, name)] * copies)


def zstd(data):
    return zstandard.ZstdCompressor(level=1).compress(data)


def compressed_messages(good, frame, count):
    messages = [(name, time, zstd(payload)) for name, time, payload in good.messages[:2000]] + [
        ('joint_states', 10**9 + k, frame) for k in range(count)
    ]
    return bag(good, messages=messages)


DEEP = 100_000
MERGES = 'a0: &a0 {b: 1}\n' + '\n'.join(
    f'a{k}: &a{k} {{<<: [{", ".join([f"*a{k - 1}"] * 9)}]}}' for k in range(1, 12)
)
LAUGHS = 'a0: &a0 [x, x]\n' + '\n'.join(
    f'a{k}: &a{k} [{", ".join([f"*a{k - 1}"] * 9)}]' for k in range(1, 12)
)
CONFIGS = {
    'brackets': '[' * DEEP,
    'closed brackets': '[' * DEEP + ']' * DEEP,
    'braces': '{"a":' * DEEP + '1' + '}' * DEEP,
    'dashes': '- ' * DEEP,
    'question marks': '? ' * DEEP,
    'indentation': '\n'.join(' ' * k + 'a:' for k in range(1500)),
    'merge keys': MERGES,
    'laughs': LAUGHS,
    'cycle': '&a {a: *a, joints: *a}',
    'list': '[1, 2]',
    'text': 'hello',
    'nothing': '',
    'number': '1' + '0' * 5000,
    'object': '!!python/object/apply:os.system [touch /tmp/owned]',
    'binary': 'scenario: !!binary aGVsbG8=',
    'date': '{scenario: 2001-01-01, law: smc}',
    'set': 'joints: !!set {a, b, c}',
    'large': '#' * 20_000_000,
    'anchors': '\n'.join(f'k{k}: &a{k} 1' for k in range(60_000)),
    'not UTF-8': b'scenario: \xff\xfe',
    'control': 'scenario: "\\u001b[2J"',
}
VALUES = {
    'law': ([1], '../../x', '', 'x' * LONG, ESCAPE, None, 3, {'a': 1}, 'unknown'),
    'scenario': ([1], '../../../etc/passwd', 'x' * LONG, ESCAPE, 'nothing'),
    'joints': (
        [], 'abc', ['a', 'a', 'a'], ['joint1'], [1, 2, 3], [['a'], ['b'], ['c']], None,
        [ESCAPE, 'b', 'c'], ['x' * LONG, 'b', 'c'],
    ),
    'period': (0, -1, 1e-300, 1e300, 'a', [1e-3], True, 10**30, 0.0007),
    'duration': (-1, 1e300, 1e9, 'long', None),
    'time_mode': ('never', 1, ['wall']),
    'custom_laws': ('x', [1], ['/etc/passwd'], ['/dev/stdin'], [['a']]),
    'custom_trajectories': ('x', [1], ['/etc/passwd']),
    'plant.torque_limit': (0, 'a', [1, 2], [], 1e308, [math.pi, 'a', 1]),
    'robot.l1': (0, -1, 1e308, 'a', [1], 1e-300),
    'robot.base_x': ([1, 2], [1, 1, 1], 'abc', [0, 1, 'a']),
    'trajectory.shape': ([1], 'spiral', {'a': 1}),
    's_fotsmc.G': ('a', [1, 2], -1, 1e308, None),
    'middleware': ('/tmp/evil.xml', [1]),
    'made_up': ([[1]], {'a': {'b': 1}}, ESCAPE, 'x' * LONG),
    ESCAPE: (1,),
}  # fmt: skip
STAMPS = (
    '²', '9' * 5000, '-' + '1' + '0' * 40, 'nan', '', ' 5', '5.0', '1e9', '-1', '0x10', '\uff11',
)  # fmt: skip
CHANGES = {
    'date': {'stamp': '1200000000', 'node': '/controller', 'values': '{law: 2001-01-01}'},
    'list': {'stamp': '1200000000', 'node': '/controller', 'values': '{law: [1]}'},
    'texts': {'stamp': '1200000000', 'node': '/controller', 'values': '{s_fotsmc.G: [a], law: 3}'},
    'brackets': {'stamp': '1200000000', 'node': '/controller', 'values': '[' * DEEP},
    'large': {'stamp': str(2**70), 'node': '/controller', 'values': 'law: smc'},
    'unknown law': {'stamp': '1100000000', 'node': '/controller', 'values': 'law: none_such'},
    'node': {'stamp': '1', 'node': ESCAPE, 'values': 'law: smc'},
    'nothing': {},
}
ATTACHMENTS = {
    'NUL': 'custom_laws/a\0b',
    'parent': 'custom_laws/../../../owned',
    'absolute': 'custom_laws//tmp/owned',
    'long': 'custom_laws/' + 'x' * 300,
    'very long': 'custom_laws/' + 'x' * LONG,
    'empty': 'custom_laws/',
    'escape': 'custom_laws/' + ESCAPE,
    'a law of the suite': 'custom_laws/smc',
    'dots': 'custom_laws/..',
    'a robot of the suite': 'custom_robots/planar_3rrr',
    'robot NUL': 'custom_robots/a\0b',
    'robot parent': 'custom_robots/../../../owned',
    'trajectory parent': 'custom_trajectories/../../../owned',
}
NUMBERS = (math.nan, math.inf, -math.inf, 1e308, -1e308, 1e155, 1e300, 5e-324)
EXTREMES = {
    'all equal': lambda k: (1, 0),
    'backwards': lambda k: (1000 - k, 0),
    'largest': lambda k: (2**31 - 1, 2**32 - 1),
    'smallest': lambda k: (-(2**31), k),
    'both ends': lambda k: (-(2**31) if k % 2 else 2**31 - 1, 0),
    'one far away': lambda k: (2**31 - 1 if k == 30 else 1, k * 10**6),
    'zero': lambda k: (0, 0),
}


@functools.cache
def files():
    """Name to a function that makes of the good bag the content of one file."""
    found = {
        'good': lambda good: good.data,
        'empty file': lambda good: b'',
        'text': lambda good: b'this is not a bag\n' * 100,
        'magic alone': lambda good: MAGIC,
        'two magics': lambda good: MAGIC + MAGIC,
        'by hand': lambda good: by_hand(described(), chunk(content(good))),
        # chunks
        'empty chunk': lambda good: by_hand(described(), chunk(b''), chunk(content(good))),
        'empty zstd chunk': lambda good: by_hand(
            described(), zstd_chunk(b''), chunk(b'', b'', 'zstd'), zstd_chunk(content(good))),
        'empty lz4 chunk': lambda good: by_hand(
            described(), chunk(b'', b'', 'lz4'), chunk(b'', lz4.frame.compress(b''), 'lz4'),
            chunk(content(good))),
        'short chunk': lambda good: by_hand(
            described(), *(chunk(record(4, b'', k) + bytes(k)) for k in (0, 1, 5, 20)),
            chunk(schema(90, 'a')), chunk(record(0x80, b'')), chunk(content(good))),
        'chunk of less than a record': lambda good: by_hand(
            described(), *(chunk(bytes(k)) for k in range(1, 31)), chunk(content(good))),
        'nothing but an empty chunk': lambda good: by_hand(described(), chunk(b'')),
        'chunk of eight million records': lambda good: by_hand(
            described(), chunk(content(good)),
            *[zstd_chunk(message(1, 5, b'') * (LIE // 4 // 31))] * 4),
        'chunk of schemas': lambda good: by_hand(
            described(), chunk(content(good)),
            *[zstd_chunk(record(3, bytes(14)) * (LIE // 8 // 23))] * 4),
        'chunk in a chunk': lambda good: by_hand(
            described(), chunk(chunk(chunk(content(good)))), chunk(content(good))),
        'unknown compression': lambda good: by_hand(
            described(), chunk(content(good), compression='brotli'), chunk(content(good))),
        'wrong CRC': lambda good: by_hand(
            described(), chunk(content(good), crc=5), chunk(content(good))),
        # lies about lengths
        **{
            f'chunk that claims {size}': lambda good, size=size: by_hand(
                described(), zstd_chunk(content(good), size=size), chunk(content(good)))
            for size in (0, 1, LIE - 1, LIE, HUGE, 2**64 - 1)
        },
        **{
            f'record of {opcode} that claims {length}': lambda good, opcode=opcode, length=length:
                by_hand(described(), chunk(content(good)), record(opcode, b'abc', length))
            for opcode in (1, 3, 4, 5, 6, 7, 8, 9, 11, 12, 15)
            for length in (2**31, HUGE, 2**64 - 1, 2**64 - 9)
        },
        'message index that lies': lambda good: by_hand(
            described(), chunk(content(good)),
            record(7, struct.pack('<HI', 1, 2**32 - 1) + bytes(160)), chunk(content(good))),
        'footer far away': lambda good: good.data[:-37] + record(
            2, struct.pack('<QQI', HUGE, HUGE, 0)) + MAGIC,
        'footer at itself': lambda good: good.data[:-37] + record(
            2, struct.pack('<QQI', len(good.data) - 37, len(good.data) - 37, 0)) + MAGIC,
        'footer at the beginning': lambda good: good.data[:-37] + record(
            2, struct.pack('<QQI', 8, 8, 0)) + MAGIC,
        'index at the same chunk again and again': lambda good: many_indexes(good, 5000),
        'index that points nowhere': lambda good: wrong_index(good, HUGE),
        'index that points at a text': lambda good: wrong_index(good, 20),
        'summary offsets that lie': lambda good: good.data.replace(
            struct.pack('<BQ', 14, 17), struct.pack('<BQ', 14, 18)),
        # bombs
        'zstd bomb': lambda good: bomb(good, 40, zstd),
        'lz4 bomb': lambda good: bomb(good, 20, lz4.frame.compress),
        'zstd bomb of zeros': lambda good: by_hand(
            described(), chunk(content(good)), *[chunk(b'', zeros(LIE), 'zstd', LIE)] * 20),
        'zstd bomb that lies': lambda good: by_hand(
            described(), chunk(content(good)), chunk(b'', zeros(ZEROS), 'zstd', 1000),
            chunk(b'', zeros(ZEROS, 1000), 'zstd', 1000), chunk(b'', zeros(ZEROS), 'zstd', LIE),
            chunk(b'', zeros(1 << 17, LIE), 'zstd', LIE)),
        'lz4 bomb that lies': lambda good: by_hand(
            described(), chunk(content(good)),
            *[chunk(b'', lz4.frame.compress(bytes(LIE)), 'lz4', size) for size in (9, LIE, HUGE)]),
        'few large messages, compressed': lambda good: compressed_messages(
            good, zeros(LIE, LIE), 6),
        'many messages, compressed': lambda good: compressed_messages(
            good, zeros(1 << 17, 1 << 17), 2000),
        'messages that lie, compressed': lambda good: compressed_messages(
            good, zeros(ZEROS // 8, 1 << 20), 5),
        'messages without size, compressed': lambda good: compressed_messages(
            good, zeros(ZEROS // 8), 5),
        'messages that are broken, compressed': lambda good: compressed_messages(
            good, zeros(1 << 17)[:9], 100),
        # metadata
        **{
            f'config: {name}': lambda good, config=config: with_config(good, config)
            for name, config in CONFIGS.items() if isinstance(config, str)
        },
        'config: not UTF-8': lambda good: by_hand(
            metadata('parallel_robot', {'config': CONFIGS['not UTF-8']}), described(),
            chunk(content(good))),
        **{
            f'{key[:20]!r}: {value!r:.40}': lambda good, key=key, value=value: configured(
                good, **{key: value})
            for key, values in VALUES.items() for value in values
        },
        **{
            f'start_stamp {stamp!r:.20}': lambda good, stamp=stamp: with_facts(
                good, start_stamp=stamp)
            for stamp in STAMPS
        },
        'start_stamp beyond': lambda good: with_facts(good, start_stamp=str(2**63 - 1)),
        **{
            f'lost {stamp!r:.20}': lambda good, stamp=stamp: bag(good, notes=[
                ('parallel_robot_messages', {'joint_states': f'written 5, lost {stamp}'})])
            for stamp in STAMPS
        },
        **{
            f'stamp of a change {stamp!r:.20}': lambda good, stamp=stamp: bag(good, notes=[
                ('parallel_robot_changes',
                 {'stamp': stamp, 'node': '/controller', 'values': 'law: smc'})])
            for stamp in STAMPS
        },
        **{
            f'change: {name}': lambda good, change=change: bag(good, notes=[
                ('parallel_robot_changes', change),
                ('parallel_robot_parameters', {change.get('node', ''): change.get('values', '')})])
            for name, change in CHANGES.items()
        },
        'a hundred thousand metadata records': lambda good: by_hand(
            described(), chunk(content(good)), metadata('parallel_robot_changes', {}) * 120_000),
        'metadata of a million keys': lambda good: by_hand(
            metadata('parallel_robot', {f'{k}': '' for k in range(300_000)}),
            described(), chunk(content(good))),
        'no time mode': lambda good: bag(good, {
            key: value for key, value in good.facts.items()
            if key not in ('time_mode', 'scenario', 'law', 'source')}),
        'facts that lie': lambda good: with_facts(
            good, scenario=ESCAPE, law=ESCAPE, time_mode=ESCAPE, version=ESCAPE + 'x' * LONG,
            revision='\0' * 100),
        'no facts': lambda good: bag(good, {}),
        # attachments
        **{
            f'attachment: {name}': lambda good, title=title: bag(good, attachments=[
                (title, b'not Python')])
            for name, title in ATTACHMENTS.items()
        },
        'a thousand attachments': lambda good: bag(good, attachments=[
            (f'custom_laws/a{k}', b'x') for k in range(1000)]),
        'huge attachment': lambda good: bag(
            good, attachments=[('custom_laws/a', bytes(3 * 10**7))]
        ),
        # schemas, channels, messages
        'schema twice': lambda good: by_hand(
            described(), described(), schema(1, 'other/msg/Type'), chunk(content(good))),
        'channel twice': lambda good: by_hand(
            described(), channel(1, '/reference', 2), chunk(content(good))),
        'channels without schemas': lambda good: by_hand(
            b''.join(channel(number, f'/{name}', 0) for name, (number, _) in CHANNELS.items()),
            chunk(content(good))),
        'other schemas': lambda good: by_hand(
            b''.join(schema(n, 'sensor_msgs/msg/Image') + channel(n, f'/{name}', n)
                     for name, (n, _) in CHANNELS.items()), chunk(content(good))),
        'schemas exchanged': lambda good: by_hand(
            b''.join(schema(n, topic.type) + channel(n, f'/{name}', 13 - n)
                     for name, (n, topic) in CHANNELS.items()), chunk(content(good))),
        'sixty thousand channels': lambda good: by_hand(
            schema(1, 'sensor_msgs/msg/JointState')
            + b''.join(channel(k, f'/s{k}/joint_states', 1) for k in range(1, 60_000)),
            chunk(content(good))),
        'sixty thousand other channels': lambda good: by_hand(
            described(),
            b''.join(channel(k, f'/{ESCAPE}{k}', 0) for k in range(100, 60_000)),
            chunk(content(good) + b''.join(message(k, 5, bytes(4)) for k in range(100, 60_000)))),
        'no messages': lambda good: bag(good, messages=[]),
        'no chunk': lambda good: bag(good, use_chunking=False),
        'no index': lambda good: by_hand(described(), chunk(content(good)), indexed=False),
        **{
            f'without {name}': lambda good, name=name: bag(
                good, messages=[m for m in good.messages if m[0] != name])
            for name in ('joint_states', 'reference', 'effort_controller/commands',
                         'controller/answered', 'controller/status')
        },
        'one message of each': lambda good: bag(good, messages=list(
            {name: (name, time, payload) for name, time, payload in good.messages}.values())),
        'two messages of each': lambda good: bag(good, messages=good.messages[:26]),
        'in a namespace': lambda good: bag(good, space='/left'),
        'topic with escapes': lambda good: bag(good, messages=[
            *good.messages, (ESCAPE, 5, layouts.text_message(ESCAPE)), ('x' * 60_000, 5, b'a'),
            ('', 5, b''), ('../../x', 5, b''), ('a b', 5, b'')]),
        **{
            f'{name} {what}': lambda good, name=name, change=change: bag(good, messages=[
                (topic, time, change(payload) if topic == name else payload)
                for topic, time, payload in good.messages])
            for name in CHANNELS
            for what, change in {
                'empty': lambda payload: b'',
                'of one byte': lambda payload: b'\0',
                'cut': lambda payload: payload[:len(payload) // 2],
                'longer': lambda payload: payload + bytes(7),
                'of 0xff': lambda payload: b'\xff' * len(payload),
                'big endian': lambda payload: b'\0\0\0\0' + payload[4:],
                'with large counts': lambda payload: payload[:12] + b'\xff\xff\xff\x7f' * 9,
                'long': lambda payload: payload + bytes(100_000),
            }.items()
        },
        'each message another length': lambda good: bag(good, messages=[
            (name, time, payload + bytes(k % 3000)) for k, (name, time, payload) in
            enumerate(good.messages)]),
        # joints
        'five joints': lambda good: joints(good, tuple('abcde')),
        'five joints, three configured': lambda good: joints(good, tuple('abcde'), False),
        'two joints': lambda good: joints(good, ('a', 'b')),
        'no joints': lambda good: joints(good, ()),
        'joints of one name': lambda good: joints(good, ('a', 'a', 'a')),
        'joint that is a formula': lambda good: renamed(good, ("=cmd|'/C calc'!A0", '+1', '@a')),
        'joint that is an escape': lambda good: renamed(good, (ESCAPE, 'a\nb', 'c')),
        'joint that is mathematics': lambda good: renamed(good, ('$\\frac{', '<script>', '&')),
        'joints with long names': lambda good: renamed(good, ('a' * 199, 'b' * 199, 'c' * 199)),
        'joints with longer names': lambda good: renamed(good, ('a' * 10_000, 'b', 'c')),
        'joint with a very long name': lambda good: joints(
            good._replace(messages=good.messages[:30]), ('a' * (LONG // 10), 'b', 'c')),
        'commands of two': lambda good: edited(
            good, 'effort_controller/commands', field('data', 0), layouts.float64_multi_array(2)),
        'commands of four': lambda good: edited(
            good, 'effort_controller/commands', field('data', 0), layouts.float64_multi_array(4)),
        'commands of none': lambda good: edited(
            good, 'effort_controller/commands', lambda *_: None, layouts.float64_multi_array(0)),
        # numbers
        **{
            f'{name} {key} {number} {every}':
                lambda good, name=name, key=key, number=number, every=every: edited(
                    good, name, field(key, number, every))
            for name, keys in {
                'joint_states': ('position', 'velocity', 'effort'),
                'reference': ('position', 'velocity', 'acceleration'),
                'effort_controller/commands': ('data',),
            }.items()
            for key in keys for number in NUMBERS for every in (1, 7)
        },
        **{
            f'{name} stamps {what}': lambda good, name=name, stamp=stamp: edited(
                good, name, stamps(stamp))
            for name in ('joint_states', 'reference') for what, stamp in EXTREMES.items()
        },
        'answers that lie': lambda good: bag(good, messages=[
            (name, time, lies(payload) if name == 'controller/answered' else payload)
            for name, time, payload in good.messages]),
        **{
            f'log times {what}': lambda good, at=at: bag(good, messages=[
                (name, at(time), payload) for name, time, payload in good.messages])
            for what, at in {
                'equal': lambda time: 5, 'zero': lambda time: 0,
                'largest': lambda time: 2**64 - 1, 'backwards': lambda time: 2**40 - time,
                'signed': lambda time: 2**63 + time,
            }.items()
        },
    }  # fmt: skip
    for k in range(40):
        found[f'cut {k}'] = lambda good, k=k: good.data[: len(good.data) * k // 40 + k]
        found[f'flipped {k}'] = lambda good, k=k: flipped(good.data, k)
    return found


def lies(answers):
    """The torques of these answers with stamps that are none."""
    layout = layouts.int64_multi_array((len(answers) - 20) // 8)
    rows = layout.decode(answers)['data'].reshape(-1, 6).copy()
    rows[:, :3] = [2**63 - 1, -(2**63), 0]
    rows[::2, :3] = [2**62, -5, 1]
    return layout.encode(data=rows.ravel())


def flipped(data, seed):
    changed, source = bytearray(data), random.Random(seed)
    for _ in range(1 + seed % 5):
        changed[source.randrange(len(data))] ^= 1 << source.randrange(8)
    return bytes(changed)


def many_indexes(good, count):
    inside = described() + content(good) + message(1, 5, bytes(LIE // 16))
    data = MAGIC + header()
    begin = len(data)
    data += zstd_chunk(inside)
    indexes = chunk_index(begin, 5) * count
    start = len(data) + len(record(15, bytes(4)))
    return data + end(described() + statistics(count) + indexes, start) + MAGIC


def wrong_index(good, offset):
    data = MAGIC + header() + chunk(described() + content(good))
    start = len(data) + len(record(15, bytes(4)))
    summary = described() + statistics(5) + chunk_index(offset, 5)
    return data + end(summary, start) + MAGIC


def put(good, directory, name='bag_0.mcap', data=None):
    directory.mkdir(parents=True, exist_ok=True)
    (directory / name).write_bytes(good.data if data is None else data)


YAMLS = {
    'other files': 'rosbag2_bagfile_information:\n  relative_file_paths: [../../x, /etc/passwd]\n',
    'deep': '[' * DEEP,
    'merge keys': MERGES,
    'types': 'rosbag2_bagfile_information: [custom_data]\n',
    'facts': 'rosbag2_bagfile_information: {custom_data: {config: [1], start_stamp: x}}\n',
    'control': 'rosbag2_bagfile_information: {custom_data: {config: "{law: \\"\\\\e[2J\\"}"}}\n',
    'thousands': 'rosbag2_bagfile_information: {relative_file_paths: ['
    + ', '.join(f'bag_{k}.mcap' for k in range(100_000)) + ']}\n',
    'large': '#' * 50_000_000,
}  # fmt: skip


def with_yaml(good, directory, content):
    """metadata.yaml counts where the file of the bag is damaged."""
    put(good, directory, data=flipped(good.data, 3)[:-100])
    (directory / 'metadata.yaml').write_text(content)


def pipe(good, directory):
    directory.mkdir()
    os.mkfifo(directory / 'bag_0.mcap')


def pipe_beside(good, directory):
    put(good, directory, data=good.data[:-100])
    os.mkfifo(directory / 'metadata.yaml')


def link_to_itself(good, directory):
    directory.mkdir()
    (directory / 'bag_0.mcap').symlink_to('bag_0.mcap')


def device(good, directory):
    directory.mkdir()
    (directory / 'bag_0.mcap').symlink_to('/dev/zero')


def link_to_its_directory(good, directory):
    put(good, directory)
    (directory / 'bag_1.mcap').symlink_to('.')


def folder(good, directory):
    (directory / 'bag_0.mcap').mkdir(parents=True)


def unreadable(good, directory):
    put(good, directory)
    (directory / 'bag_0.mcap').chmod(0)


def many_files(good, directory):
    for k in range(2000):
        put(good, directory, f'bag_{k}.mcap', good.data if k == 7 else MAGIC + header())


def odd_names(good, directory):
    put(good, directory, 'bag\x1b[2J\n.mcap')
    put(good, directory, os.fsdecode(b'bag_\xff.mcap'), b'')


def names_of_digits(good, directory):
    put(good, directory, '9' * 240 + '.mcap')
    put(good, directory, 'bag_²٣.mcap')


def split(good, directory):
    half = len(good.messages) // 2
    put(good, directory, 'bag_0.mcap', bag(good, messages=good.messages[:half]))
    put(good, directory, 'bag_1.mcap', bag(good, messages=good.messages[half:]))


def sparse(good, directory):
    put(good, directory, data=by_hand(described(), chunk(content(good)), indexed=False)[:-50])
    with (directory / 'bag_0.mcap').open('r+b') as file:
        file.seek(0, 2)
        file.write(struct.pack('<BQ', 9, 5 * 10**8))
        file.truncate(5 * 10**8 + file.tell())


DIRECTORIES = {
    'empty directory': lambda good, directory: directory.mkdir(),
    'a file': lambda good, directory: directory.write_bytes(good.data),
    'a text': lambda good, directory: directory.write_text('hello'),
    'a pipe': lambda good, directory: os.mkfifo(directory),
    'a link to itself': lambda good, directory: directory.symlink_to(directory.name),
    'nothing': lambda good, directory: None,
    'pipe in it': pipe,
    'pipe beside it': pipe_beside,
    'link to itself in it': link_to_itself,
    'device in it': device,
    'link to its directory in it': link_to_its_directory,
    'folder in it': folder,
    'unreadable': unreadable,
    'many files': many_files,
    'odd names': odd_names,
    'names of digits': names_of_digits,
    'split': split,
    'sparse': sparse,
    'packed': lambda good, directory: put(good, directory, 'bag_0.mcap.zstd', zstd(good.data)),
    'packed and cut': lambda good, directory: put(
        good, directory, 'bag_0.mcap.zstd', zstd(good.data)[:-500]),
    'packed bomb': lambda good, directory: put(
        good, directory, 'bag_0.mcap.zstd', zeros(2 * ZEROS)),
    'packed bomb that lies': lambda good, directory: put(
        good, directory, 'bag_0.mcap.zstd', zstd(good.data) + zeros(2 * ZEROS, 5)),
    'packed records': lambda good, directory: put(
        good, directory, 'bag_0.mcap.zstd',
        zstd(MAGIC + header() + record(7, struct.pack('<HI', 1, 0)) * 4_000_000)),
    **{
        f'metadata.yaml: {name}': lambda good, directory, content=content: with_yaml(
            good, directory, content)
        for name, content in YAMLS.items()
    },
}  # fmt: skip


def write(name, good, directory):
    """Make one bag: a directory, or whatever stands in its place."""
    if name in DIRECTORIES:
        DIRECTORIES[name](good, directory)
    else:
        put(good, directory, data=files()[name](good))


def names():
    return [*files(), *DIRECTORIES]
