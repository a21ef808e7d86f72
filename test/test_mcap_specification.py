"""Files as the specification of MCAP allows them, in all combinations of its conformance suite.

The variants are those of tests/conformance in foxglove/mcap: ten messages or one, with a schema or
without, an attachment, metadata, nothing; each with and without chunks, indexes, repeated records,
statistics, summary offsets, and extra bytes at the end of records.
"""

import hashlib
import itertools
import struct
from zlib import crc32

import pytest

from parallel_robot.bags.bag_reader import read
from parallel_robot.bags.files import mcap_reader
from parallel_robot.bags.files.mcap_records import Block
from parallel_robot.bags.indexed_reader import BagReader
from parallel_robot.bags.limits import Allowance
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.messages import topics

MAGIC = b'\x89MCAP0\r\n'
PAD = b'\x01\xff\xff'
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, INDEX = range(1, 8)
CHUNK_INDEX, ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX = range(8, 14)
SUMMARY_OFFSET, DATA_END, PRIVATE, FUTURE = 14, 15, 0x80, 0x20
TIMES = (0, 2, 1, 3, 3, 5, 4, 7, 8, 9)


def text(word):
    return struct.pack('<I', len(word)) + word.encode()


def pairs(items):
    content = b''.join(text(key) + text(value) for key, value in items.items())
    return struct.pack('<I', len(content)) + content


def message(log_time, sequence, publish_time):
    return struct.pack('<HIQQ', 1, sequence, log_time, publish_time) + b'\1\2\3'


FIRST = struct.pack('<H', 1) + text('Example') + text('c') + struct.pack('<I', 3) + b'\4\5\6'
ATTACHED = struct.pack('<QQ', 2, 1) + text('myFile') + text('application/octet-stream')
ATTACHED += struct.pack('<Q', 3) + b'\1\2\3'
INPUTS = {
    'NoData': [],
    'OneSchemalessMessage': [
        (CHANNEL, struct.pack('<HH', 1, 0) + text('example') + text('text') + pairs({})),
        (MESSAGE, message(2, 10, 1)),
    ],
    'OneMessage': [
        (SCHEMA, FIRST),
        (CHANNEL, struct.pack('<HH', 1, 1) + text('example') + text('a') + pairs({'foo': 'bar'})),
        (MESSAGE, message(2, 10, 1)),
    ],
    'OneAttachment': [(ATTACHMENT, ATTACHED + struct.pack('<I', crc32(ATTACHED)))],
    'OneMetadata': [(METADATA, text('myMetadata') + pairs({'foo': 'bar'}))],
}
INPUTS['TenMessages'] = [
    *INPUTS['OneMessage'][:2],
    *((MESSAGE, message(time, sequence, time)) for sequence, time in enumerate(TIMES)),
]
SUITE = (  # of names and digests of all files of the suite, so that these are the same
    '447d6e17b96515c5f9fc442e0facb4ad06de3d6ca6d2640ee94a453ec655d115'
)
FEATURES = ('ch', 'mx', 'st', 'rsh', 'rch', 'ax', 'mdx', 'chx', 'sum', 'pad')
NEEDS = {'mx': 'ch', 'chx': 'ch'}
OF = {'ax': ATTACHMENT, 'mdx': METADATA, 'rsh': SCHEMA, 'rch': CHANNEL}
SUMMARY = {'chx', 'rsh', 'rch', 'mdx', 'ax', 'st'}


def variants():
    for name, records in INPUTS.items():
        kinds = {kind for kind, _ in records}
        for count in range(len(FEATURES) + 1):
            for chosen in map(set, itertools.combinations(FEATURES, count)):
                of = all(kind in kinds for key, kind in OF.items() if key in chosen)
                chunked = kinds & {SCHEMA, CHANNEL, MESSAGE} or not chosen & {'ch', 'chx', 'mx'}
                nested = all(other in chosen for key, other in NEEDS.items() if key in chosen)
                offsets = 'sum' not in chosen or chosen & SUMMARY
                if of and chunked and nested and offsets:
                    yield name, frozenset(chosen)


class File:
    """A file that is written record by record."""

    def __init__(self, pad, unpadded=(DATA_END, FOOTER, MESSAGE, CHUNK)):
        self.data, self.pad, self.unpadded = bytearray(MAGIC), pad, unpadded

    def add(self, kind, content):
        start = len(self.data)
        content += PAD if self.pad and kind not in self.unpadded else b''
        self.data += struct.pack('<BQ', kind, len(content)) + content
        return start, len(self.data) - start


def written(
    records, features, compression='', unpadded=(DATA_END, FOOTER, MESSAGE, CHUNK), between=()
):
    """A file of some records; `between`: others that stand before each of them."""
    file = File('pad' in features, unpadded)
    file.add(HEADER, text('') + text(''))
    inside, times, indexes, summary = File(False), [], [], []
    inside.data = bytearray()
    counts = {kind: sum(each == kind for each, _ in records) for kind in range(16)}
    for kind, content in records:
        for extra in between:
            file.add(*extra)
        if 'ch' in features and kind in (SCHEMA, CHANNEL, MESSAGE):
            for extra in between:
                inside.add(*extra)
            start, _ = inside.add(kind, content)
            if kind == MESSAGE:
                times.append((struct.unpack_from('<Q', content, 6)[0], start))
            continue
        start, length = file.add(kind, content)
        if kind == ATTACHMENT and 'ax' in features:
            name = text('myFile') + text('application/octet-stream')
            body = struct.pack('<QQQQQ', start, length, 2, 1, 3) + name
            indexes.append((ATTACHMENT_INDEX, body))
        if kind == METADATA and 'mdx' in features:
            indexes.append(
                (METADATA_INDEX, struct.pack('<QQ', start, length) + text('myMetadata'))
            )
    if 'ch' in features:
        data = bytes(inside.data)
        ends = (min(times)[0], max(times)[0]) if times else (0, 0)
        body = struct.pack('<QQQI', *ends, len(data), crc32(data)) + text(compression)
        start, length = file.add(CHUNK, body + struct.pack('<Q', len(data)) + data)
        offsets, size = b'', 0
        if 'mx' in features:
            rows = b''.join(struct.pack('<QQ', *row) for row in times)
            place, size = file.add(INDEX, struct.pack('<HI', 1, len(rows)) + rows)
            offsets = struct.pack('<HQ', 1, place)
        if 'chx' in features:
            body = struct.pack('<QQQQI', *ends, start, length, len(offsets)) + offsets
            body += struct.pack('<Q', size) + text(compression)
            indexes.append((CHUNK_INDEX, body + struct.pack('<QQ', len(data), len(data))))
    file.add(DATA_END, struct.pack('<I', crc32(file.data)))
    for key, kind in (('rsh', SCHEMA), ('rch', CHANNEL)):
        summary += [record for record in records if record[0] == kind and key in features]
    if 'st' in features:
        found = [struct.unpack_from('<Q', body, 6)[0] for kind, body in records if kind == MESSAGE]
        body = struct.pack('<QHI', len(found), counts[SCHEMA], counts[CHANNEL])
        body += struct.pack('<III', counts[ATTACHMENT], counts[METADATA], 'ch' in features)
        body += struct.pack('<QQ', min(found, default=0), max(found, default=0))
        rows = struct.pack('<HQ', 1, len(found)) if found else b''
        summary.append((STATISTICS, body + struct.pack('<I', len(rows)) + rows))
    summary += indexes
    begin, groups = len(file.data), []
    for kind, members in itertools.groupby(summary, key=lambda record: record[0]):
        start = len(file.data)
        for record in members:
            file.add(*record)
        groups.append(struct.pack('<BQQ', kind, start, len(file.data) - start))
    end = len(file.data)
    if 'sum' in features:
        for group in groups:
            file.add(SUMMARY_OFFSET, group)
    places = struct.pack('<QQ', begin if summary else 0, end if 'sum' in features else 0)
    head = struct.pack('<BQ', FOOTER, 20) + places
    file.data += head + struct.pack('<I', crc32(file.data[begin:] + head)) + MAGIC
    return bytes(file.data)


def scanned(data):
    return list(mcap_reader.scan(memoryview(data), Allowance('file', len(data))))


def told(found):
    """What was read: times and sequence numbers of messages, names of the rest."""
    rows = [row for record in found if isinstance(record, Block) for row in record.rows()]
    names = [type(record).__name__ for record in found if not isinstance(record, Block)]
    return [(log_time, sequence) for _, sequence, log_time, *_ in rows], {*names} - {'Header'}


def test_all_variants_of_the_conformance_suite():
    names = {SCHEMA: 'Schema', CHANNEL: 'Channel', ATTACHMENT: 'Attachment', METADATA: 'Metadata'}
    digests = {}
    for name, features in variants():
        records = INPUTS[name]
        data = written(records, features)
        digests['-'.join([name, *sorted(features)]) + '.mcap'] = hashlib.sha256(data).hexdigest()
        messages, kinds = told(scanned(data))
        place = name, sorted(features)
        wanted = [
            struct.unpack_from('<IQ', body, 2)[::-1] for kind, body in records if kind == MESSAGE
        ]
        assert messages == wanted, place
        expected = {names[kind] for kind, _ in records if kind in names}
        assert kinds == expected | ({'Statistics'} if 'st' in features else set()), place
    lines = ''.join(f'{name}:{digest}\n' for name, digest in sorted(digests.items()))
    assert len(digests) == 416
    assert hashlib.sha256(lines.encode()).hexdigest() == SUITE


@pytest.mark.parametrize('kind', [PRIVATE, 0xFF, FUTURE])
@pytest.mark.parametrize('features', [{'ch', 'mx', 'chx', 'st', 'rsh', 'rch'}, set()])
def test_private_and_later_records_are_passed(kind, features):
    extra = [(kind, b''), (kind, b'\5' * 50)]
    data = written(INPUTS['TenMessages'], features, between=extra)
    messages, kinds = told(scanned(data))
    assert [time for time, _ in messages] == [*TIMES]
    assert 'Damage' not in kinds


def test_bytes_behind_the_content_of_a_chunk_are_passed():
    data = written(INPUTS['TenMessages'], {'ch', 'pad'}, unpadded=(FOOTER, MESSAGE))
    messages, kinds = told(scanned(data))
    assert [time for time, _ in messages] == [*TIMES] and 'Damage' not in kinds


def test_the_index_of_padded_files_is_read(tmp_path):
    for features in ({'ch', 'mx', 'chx', 'st', 'rsh', 'rch', 'sum'}, {'ch', 'chx', 'st', 'rch'}):
        path = tmp_path / f'{len(features)}.mcap'
        path.write_bytes(written(INPUTS['TenMessages'], features | {'pad'}))
        assert BagReader(path).end == 9


def test_a_damaged_opcode_is_no_private_record():
    data = bytearray(written(INPUTS['TenMessages'], {'ch'}))
    at = data.index(bytes([CHUNK]), len(MAGIC) + 9 + 8)
    data[at] |= 0x80
    assert 'Damage' in told(scanned(bytes(data)))[1]


def test_an_unknown_compression_is_named(tmp_path):
    path = tmp_path / 'bag.mcap'
    path.write_bytes(written(INPUTS['TenMessages'], {'ch', 'rsh', 'rch'}, compression='brotli'))
    with pytest.raises(BagError, match=r'compressed by brotli, .* zstd, lz4 and none'):
        read(path, (topics.JOINT_STATES,), lambda *_: None)
