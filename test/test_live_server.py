"""The live page's server: who may look, who may act, and what a slow browser costs."""

import asyncio
import json
import resource
import socket
import struct
import time
from contextlib import ExitStack, asynccontextmanager, suppress

import aiohttp
import pytest

from parallel_robot.live.frames import HEADER
from parallel_robot.live.guard import BURST, HEADERS, RATE, Guard
from parallel_robot.live.server import BACKLOG, BROWSERS, Hub, LiveServer, accepting
from parallel_robot.live.source import RefusedError

PATIENCE = 20.0  # s


def frame(k, layout=1, size=8):
    body = struct.pack('<f', k) * (size // 4)
    return HEADER.pack(HEADER.size + len(body), layout, float(k), 0.0, 0) + body


def times(data):
    found = []
    while data:
        length, _, time, *_ = HEADER.unpack_from(data)
        found.append(time)
        data = data[length:]
    return found


class Source:
    """Something that moves, and notes what it was asked for."""

    def __init__(self):
        self.done, self.k = [], 0
        self.release = asyncio.Event()
        self.release.set()

    def look(self):
        self.k += 1
        return [frame(self.k)]

    def texts(self):
        return {'state': {'law': 'smc'}}

    async def act(self, action, value):
        if action not in ('law', 'emergency_stop'):
            raise KeyError(action)
        if value == 'wrong':
            raise RefusedError('there is no law wrong')
        await self.release.wait()
        self.done.append((action, value))
        return 'done'


class Site:
    """A server and what a page of it would send."""

    def __init__(self, source, port, guard, client):
        self.source, self.client, self.port = source, client, port
        self.url = f'http://127.0.0.1:{port}'
        self.host = f'127.0.0.1:{port}'
        self.headers = {'Authorization': f'Bearer {guard.token}', 'Origin': self.url}

    async def act(self, action='law', value='smc', **headers):
        """Status and text of an answer; a header that is None is not sent."""
        sent = {k: v for k, v in {**self.headers, **headers}.items() if v is not None}
        data = value if isinstance(value, bytes) else json.dumps(value).encode()
        sent.setdefault('Content-Type', 'application/json')
        async with self.client.post(f'{self.url}/do/{action}', data=data, headers=sent) as answer:
            return answer.status, await answer.text()


@asynccontextmanager
async def site(read_only=False):
    source = Source()
    live = LiveServer(source, '127.0.0.1', read_only)
    listening = socket.create_server(('127.0.0.1', 0))
    async with accepting(listening, live), aiohttp.ClientSession() as client:
        yield Site(source, listening.getsockname()[1], live.guard, client)


def run(test, **options):
    async def whole():
        async with site(**options) as made:
            await asyncio.wait_for(test(made), PATIENCE)

    asyncio.run(whole())


def test_the_page_may_act():
    async def test(site):
        assert await site.act() == (200, '{"done": true, "answer": "done"}')
        assert site.source.done == [('law', 'smc')]
        status, text = await site.act(value='wrong')
        assert status == 409 and json.loads(text) == {
            'done': False,
            'answer': 'there is no law wrong',
        }
        assert (await site.act('no_such_action'))[0] == 404

    run(test)


HUGE = b'"' + b'x' * 10_000_000 + b'"'
REFUSED = {
    'no token': ({'headers': {'Authorization': None}}, 403),
    'a wrong token': ({'headers': {'Authorization': 'Bearer x'}}, 403),
    'a token that is no ASCII': ({'headers': {'Authorization': 'Bearer \xe4'}}, 403),
    'a foreign origin': ({'headers': {'Origin': 'http://evil.example'}}, 403),
    'an origin of another port': ({'headers': {'Origin': 'http://127.0.0.1:1'}}, 403),
    'an origin that is hidden': ({'headers': {'Origin': 'null'}}, 403),
    'a name that points here': ({'headers': {'Host': 'evil.example', 'Origin': None}}, 403),
    'a form of another site': ({'headers': {'Content-Type': 'text/plain'}}, 415),
    'no JSON': ({'value': b'{'}, 400),
    'JSON that is too deep': ({'value': b'[' * 4000}, 400),
    '10 MB': ({'value': HUGE}, 413),
}


@pytest.mark.parametrize('case', REFUSED)
def test_what_is_not_from_the_page_changes_nothing(case):
    words, expected = REFUSED[case]

    async def test(site):
        headers = words.get('headers', {})
        status, text = await site.act(value=words.get('value', 'smc'), **headers)
        assert status == expected and site.headers['Authorization'][7:] not in text
        assert site.source.done == []
        assert (await site.act())[0] == 200  # and the server goes on

    run(test)


@pytest.mark.parametrize(
    'headers', [{'Origin': 'http://evil.example'}, {'Host': 'evil.example'}, {'Host': ''}]
)
def test_no_other_site_may_look(headers):
    async def test(site):
        for path in ('/', '/frames', '/live.js'):
            async with site.client.get(site.url + path, headers=headers) as answer:
                assert answer.status == 403
        with pytest.raises(aiohttp.WSServerHandshakeError, match='403'):
            await site.client.ws_connect(site.url + '/frames', headers=headers)

    run(test)


def test_a_page_that_only_shows_takes_no_request_even_with_the_token():
    async def test(site):
        for action in ('law', 'emergency_stop'):
            assert (await site.act(action))[0] == 403
        assert site.source.done == []

    run(test, read_only=True)


def test_a_flood_is_refused_and_the_emergency_stop_is_not():
    async def test(site):
        statuses = [(await site.act())[0] for _ in range(3 * int(BURST))]
        assert statuses.count(200) == len(site.source.done) < 2 * BURST
        assert set(statuses) == {200, 429}
        site.source.release.clear()
        stops = [asyncio.create_task(site.act('emergency_stop', None)) for _ in range(200)]
        await asyncio.wait(stops, timeout=0.2)
        site.source.release.set()
        assert {status for status, _ in await asyncio.gather(*stops)} == {200}
        done = site.source.done.count(('emergency_stop', None))
        assert 1 <= done < 200

    run(test)


def test_the_rate_is_that_of_the_clock():
    now = [0.0]
    guard = Guard('localhost', lambda: now[0])
    assert sum(guard.has_time() for _ in range(100)) == BURST
    now[0] = 1.0
    assert sum(guard.has_time() for _ in range(100)) == RATE
    now[0] = 1e6
    assert sum(guard.has_time() for _ in range(100)) == BURST


@pytest.mark.parametrize(
    ('host', 'known'),
    [
        ('127.0.0.1:8080', True), ('localhost', True), ('LOCALHOST:1', True), ('[::1]:80', True),
        ('192.168.0.7:80', True), ('robot.example:80', True), ('evil.example', False),
        ('127.0.0.1.evil.example', False), ('localhost.evil.example', False), ('', False),
        ('[evil]', False),
    ],
)  # fmt: skip
def test_names_of_the_server(host, known):
    assert Guard('robot.example').knows_host(host) == known


def test_the_page_asks_no_other_host_and_has_no_inline_script():
    async def test(site):
        async with site.client.get(site.url + '/') as answer:
            policy = answer.headers['Content-Security-Policy']
            text = await answer.text()
        assert "default-src 'none'" in policy and 'unsafe' not in policy
        assert "connect-src 'self'" in policy and "frame-ancestors 'none'" in policy
        assert '://' not in text and '<script>' not in text and ' style=' not in text
        for path in ('/live.js', '/robot.js', '/uplot/uPlot.iife.min.js', '/uplot/LICENSE'):
            async with site.client.get(site.url + path) as answer:
                assert (
                    answer.status == 200 and answer.headers['X-Content-Type-Options'] == 'nosniff'
                )
        for path in ('/../setup.py', '/static/live.html', '/%2e%2e/server.py', '/do/law'):
            async with site.client.get(site.url + path) as answer:
                assert answer.status == 404

    run(test)


def test_a_browser_gets_texts_then_frames_and_is_let_go_when_it_talks():
    async def test(site):
        async with site.client.ws_connect(site.url + '/frames') as socket:
            texts = [await socket.receive_json() for _ in range(2)]
            assert {name for text in texts for name in text} == {'state', 'page'}
            first = times(await socket.receive_bytes())
            later = times(await socket.receive_bytes())
            assert later[-1] > first[-1] and len(later) == 1
            with suppress(ConnectionError):  # it reads no more than the head of it
                await socket.send_bytes(bytes(10_000_000))
            while not socket.closed:
                await socket.receive()
            assert socket.close_code in (aiohttp.WSCloseCode.MESSAGE_TOO_BIG, 1006)
        async with site.client.ws_connect(site.url + '/frames') as socket:
            await socket.send_str('hello')
            while not socket.closed:
                await socket.receive()
            assert socket.close_code == aiohttp.WSCloseCode.POLICY_VIOLATION

    run(test)


def test_no_more_browsers_than_there_is_place_for():
    async def test(site):
        sockets = [await site.client.ws_connect(site.url + '/frames') for _ in range(BROWSERS)]
        with pytest.raises(aiohttp.WSServerHandshakeError, match='503'):
            await site.client.ws_connect(site.url + '/frames')
        await sockets[0].close()
        await (await site.client.ws_connect(site.url + '/frames')).close()

    run(test)


class Sleeper:
    """A browser that reads when it is woken up."""

    def __init__(self):
        self.awake = asyncio.Event()
        self.frames, self.texts, self.waiting = [], [], 0

    async def send_str(self, data):
        self.texts.append(data)

    async def send_bytes(self, data):
        self.waiting += 1
        await self.awake.wait()
        self.frames.append(times(data))


def test_a_browser_that_sleeps_is_skipped():
    async def test():
        hub, socket = Hub(), Sleeper()
        hub.show([frame(0)], {'state': 0})
        task = asyncio.create_task(hub.pass_on(socket))
        await asyncio.sleep(0)
        for k in range(1, 1000):
            hub.show([frame(k)], {'state': k})
            await asyncio.sleep(0)
        assert socket.waiting == 1 and socket.texts == ['{"state":0}']
        socket.awake.set()
        for _ in range(10):
            await asyncio.sleep(0)
        assert socket.frames == [[0.0], [999.0]] and socket.texts[1:] == ['{"state":999}']
        task.cancel()

    asyncio.run(test())


def test_a_browser_that_begins_gets_the_past_and_after_a_jump_that_of_the_jump():
    async def test():
        hub, socket = Hub(), Sleeper()
        socket.awake.set()
        hub.show([frame(k) for k in range(2 * BACKLOG)], {})
        task = asyncio.create_task(hub.pass_on(socket))
        for frames in (
            [frame(7000)],
            [frame(k, layout=2) for k in range(3)],
            [frame(3, layout=2)],
        ):
            for _ in range(5):
                await asyncio.sleep(0)
            hub.show(frames, {})
        for _ in range(5):
            await asyncio.sleep(0)
        past, *later = socket.frames
        assert past == list(range(BACKLOG, 2 * BACKLOG))
        assert later == [[7000], [0, 1, 2], [3]]
        task.cancel()

    asyncio.run(test())


def stop_by_a_new_connection(site):
    """How long the emergency stop took [s], and the answer."""
    began = time.monotonic()
    with socket.create_connection(('127.0.0.1', site.port), PATIENCE) as made:
        made.sendall(request(site, b'POST /do/emergency_stop', body=b'null'))
        answer = made.recv(4096)
        return time.monotonic() - began, answer


def request(site, start, *headers, body=b''):
    lines = [
        start + b' HTTP/1.1',
        b'Host: ' + site.host.encode(),
        b'Content-Type: application/json',
        b'Content-Length: %d' % len(body),
        b'Authorization: ' + site.headers['Authorization'].encode(),
        b'Connection: close',
        *headers,
    ]
    return b'\r\n'.join(lines) + b'\r\n\r\n' + body


@pytest.fixture
def many_files():
    """Room for the other ends of many connections."""
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(limits[0], min(4096, limits[1])), limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, limits)


@pytest.mark.parametrize('said', [b'', b'GET / HTTP/1.1\r\nHost: ', b'GET / HTTP/1.1\r\n\r\n'])
def test_connections_that_only_wait_keep_no_emergency_stop_off(said, many_files):
    async def test(site):
        with ExitStack() as stack:
            for _ in range(20):
                for _ in range(100):
                    made = stack.enter_context(socket.create_connection(('127.0.0.1', site.port)))
                    made.sendall(said)
                await asyncio.sleep(0)  # a turn of the server
            took, answer = await asyncio.to_thread(stop_by_a_new_connection, site)
            assert answer.startswith(b'HTTP/1.1 200') and site.source.done
            assert took < HEADERS / 2  # it waits for none of them to be let go

    run(test)


def test_a_connection_without_a_request_is_let_go(monkeypatch):
    monkeypatch.setattr('parallel_robot.live.guard.HEADERS', 0.1)

    async def test(site):
        reader, writer = await asyncio.open_connection('127.0.0.1', site.port)
        writer.write(b'GET / HTTP/1.1\r\n')
        with suppress(ConnectionResetError):
            assert await reader.read() == b''
        writer.close()

    run(test)


BAD = {
    'a token': (b'POST /do/law', b'Authorization: Bearer \xff'),
    'a host': (b'GET /', b'Host: \xff'),
    'an origin': (b'GET /', b'Origin: http://\xff'),
    'a path': (b'GET /\xff\xfe',),
    'an escaped path': (b'GET /%ff%00',),
    'an action': (b'POST /do/%ff\xff',),
    'a method': (b'\xffGET /',),
    'a name of a header': (b'GET /', b'\xff: 1'),
    'a length': (b'POST /do/law', b'Content-Length: \xff'),
    'an encoding': (b'POST /do/law', b'Content-Encoding: gzip'),
    'a chunk': (b'POST /do/law', b'Transfer-Encoding: chunked'),
    'a transfer': (b'POST /do/law', b'Transfer-Encoding: \xff'),
    'a type': (b'POST /do/law', b'Content-Type: \xff'),
    'a key': (b'GET /frames', b'Upgrade: websocket', b'Sec-WebSocket-Key: \xff'),
    'a long header': (b'GET /', b'X: ' + 20_000 * b'x'),
    'no HTTP': (b'\x16\x03\x01\x02',),
    'an absolute path': (b'GET http://[::1',),
    'a place': (b'GET //[/',),
}


@pytest.mark.parametrize('what', BAD)
def test_bad_bytes_are_refused_in_one_line(what, caplog):
    async def test(site):
        start, *headers = BAD[what]
        reader, writer = await asyncio.open_connection('127.0.0.1', site.port)
        writer.write(request(site, start, *headers, body=b'"\xff"'))
        answer = await reader.read()
        writer.close()
        head, _, text = answer.partition(b'\r\n\r\n')
        assert head.startswith(b'HTTP/1.1 4') or head.startswith(b'HTTP/1.0 4'), answer
        assert b'\n' not in text.partition(b'HTTP/')[0].strip()
        assert not caplog.records

    run(test)


@pytest.mark.parametrize('value', [b'"\xff"', b'"\\ud800"', b'[' * 4000, b''])
def test_a_body_of_bad_bytes_is_no_json(value):
    async def test(site):
        assert (await site.act(value=value))[0] == 400

    run(test)
