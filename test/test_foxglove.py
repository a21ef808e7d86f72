"""The server for Foxglove, beside a client that speaks its protocol."""

import asyncio
import json
import signal
import socket
import struct

import aiohttp
import mujoco
import numpy as np
import pytest
from bags import STORE
from ros_fixtures import PATIENCE, SLOW_LOOP

from parallel_robot.cli.command_line import main
from parallel_robot_model.messages.topics import RECORDED

pytest_plugins = ['ros_fixtures']

SET = [word for one in SLOW_LOOP for word in ('--set', one.replace(':=', '='))]
LATCHED = {'/controller/active_law', '/controller/status', '/robot_description'}


async def heard(address, enough):
    """Subscribe to all that is advertised until there is enough; the server's word, messages."""
    channels, told, found = {}, {}, {}
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(address, protocols=('foxglove.sdk.v1',)) as connection,
    ):
        while not enough(found):
            message = await connection.receive(PATIENCE)
            if message.type is aiohttp.WSMsgType.TEXT:
                said = json.loads(message.data)
                told[said['op']] = said
                new = {one['id']: one for one in said.get('channels', ())}
                channels |= new
                wanted = [{'id': number, 'channelId': number} for number in new]
                await connection.send_json({'op': 'subscribe', 'subscriptions': wanted})
                continue
            _, number, _ = struct.unpack_from('<BIQ', message.data)
            channel = channels[number]
            found.setdefault(channel['topic'], []).append((channel, message.data[13:]))
    return told, found


@pytest.mark.endurance
def test_a_client_gets_all_topics_and_the_robot(launch, domain):
    words = ('--foxglove', '--run', 'paper_circle', '--port', '0', *SET)
    process = launch('parallel_robot', 'live', *words, fresh=True)
    process.until(lambda: 'ws://' in process.stdout)
    (address,) = [word for word in process.stdout.split() if word.startswith('ws://')]
    assert address.startswith('ws://127.0.0.1:')
    wanted = {f'/{topic.name}' for topic in RECORDED} | {'/tf', '/robot_description'}

    def enough(found):
        return wanted <= found.keys() and len(found['/tf']) > 5

    for _ in range(2):  # the second comes late, and gets what is latched
        told, found = asyncio.run(asyncio.wait_for(heard(address, enough), PATIENCE))
        assert told['serverInfo']['capabilities'] == []
        for topic in LATCHED:
            assert found[topic]
    for topic in RECORDED:
        channel, data = found[f'/{topic.name}'][-1]
        assert (channel['encoding'], channel['schemaEncoding']) == ('cdr', 'ros2msg')
        assert channel['schemaName'] == topic.type
        STORE.deserialize_cdr(data, topic.type)
    states = [STORE.deserialize_cdr(data, c['schemaName']) for c, data in found['/joint_states']]
    assert states[-1].name[:3] == ['joint1', 'joint2', 'joint3']
    assert np.ptp([state.position[0] for state in states]) > 0
    channel, data = found['/robot_description'][-1]
    text = STORE.deserialize_cdr(data, channel['schemaName']).data
    model = mujoco.MjModel.from_xml_string(text)
    channel, data = found['/tf'][-1]
    assert channel['schemaName'] == 'foxglove.FrameTransforms'
    assert all(model.body(k).name.encode() in data for k in range(1, model.nbody))

    port = address.rpartition(':')[2]
    second = launch('parallel_robot', 'live', '--foxglove', '--port', port, fresh=True)
    assert second.wait() == 2
    assert f'cannot listen on 127.0.0.1 port {port}' in second.stderr
    assert second.stderr.count('\n') == 1
    assert process.end(signal.SIGINT) == 0
    assert process.stderr == ''
    with socket.socket() as again:
        assert again.connect_ex(('127.0.0.1', int(port))) != 0


@pytest.mark.parametrize(
    ('words', 'text'),
    [
        (['--bag', 'x'], 'Foxglove opens bags by itself'),
        (['--port', '99999'], '--port must be from 0 to 65535, not 99999'),
        (['--host', 'nowhere.invalid', '--port', '0'], 'cannot listen on nowhere.invalid'),
    ],
)
def test_wrong_words_are_refused(words, text, capsys):
    assert main(['live', '--foxglove', *words]) == 2
    err = capsys.readouterr().err
    assert text in err and err.count('\n') == 1
