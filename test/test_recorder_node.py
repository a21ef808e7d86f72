"""The recorder of any topic as a real process."""

import json
import signal

import pytest
import rclpy
from bags import content
from diagnostic_msgs.msg import DiagnosticArray
from mcap.reader import make_reader
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64, String

from parallel_robot.bags import bag_reader
from parallel_robot.bags.files.bag_files import MESSAGES
from parallel_robot.bags.indexed_reader import BagReader
from parallel_robot_model.messages import topics
from parallel_robot_model.nodes.connections import message_class, qos_of

pytest_plugins = ['ros_fixtures']

RECORDER = 'parallel_robot.bags.writing.recorder_node'
COUNT = 50


@pytest.fixture
def publishers(peer):
    """A best-effort topic, a latched one, a reliable one."""
    quick = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    return {
        'quick': peer.node.create_publisher(Float64, 'machine/quick', quick),
        'name': peer.node.create_publisher(String, 'machine/name', latched),
        'other': peer.node.create_publisher(Float64, 'other', QoSProfile(depth=100)),
    }


def diagnosed(peer):
    """Newest figures of the recorder, as a dictionary that fills itself."""
    heard = {}
    peer.node.create_subscription(
        DiagnosticArray,
        '/diagnostics',
        lambda array: heard.update({item.key: item.value for item in array.status[0].values}),
        10,
    )
    return heard


@pytest.mark.parametrize(
    ('choice', 'recorded'),
    [
        ('recorder.topics:=[machine/quick, /other]', {'quick', 'other'}),
        ('recorder.regex:=machine/', {'quick', 'name'}),
        ('recorder.all:=true', {'quick', 'name', 'other'}),
    ],
)
def test_chosen_topics_are_recorded_as_they_are_offered(
    choice, recorded, publishers, launch, peer, tmp_path
):
    heard = diagnosed(peer)
    publishers['name'].publish(String(data='latched before'))
    process = launch(RECORDER, '--ros-args', '-p', 'recorder.out:=bag', '-p', choice)
    peer.until(lambda: all(publishers[key].get_subscription_count() for key in recorded))
    for k in range(COUNT):
        for key in ('quick', 'other'):
            publishers[key].publish(Float64(data=float(k)))
    path = tmp_path / 'bag' / 'bag_0.mcap'
    assert path.exists()
    sent = {
        publishers[key].topic_name[1:]: '1' if key == 'name' else str(COUNT) for key in recorded
    }
    peer.until(lambda: sent.items() <= heard.items())
    assert process.end(signal.SIGINT) == 0
    found = {name.rpartition('/')[2]: stream for name, stream in content(path).items()}
    assert found.keys() & publishers.keys() == recorded
    for key in recorded - {'name'}:
        assert len(found[key]) == COUNT
    assert len(found.get('name', [0])) == 1
    reader = BagReader(tmp_path / 'bag')
    assert {name for name, topic in reader.topics.items() if topic.latched} >= {
        f'/machine/{key}' for key in recorded if key == 'name'
    }
    with path.open('rb') as stream:
        (metadata,) = (
            r.metadata for r in make_reader(stream).iter_metadata() if r.name == MESSAGES
        )
    if 'quick' in recorded:
        assert json.loads(metadata['machine/quick']) == {'written': COUNT, 'lost': 0}


def test_a_recorder_that_stands_still_for_seconds_loses_nothing(launch, peer, tmp_path):
    heard, count = diagnosed(peer), 3 * topics.QUEUE
    publisher = peer.node.create_publisher(Float64, 'number', QoSProfile(depth=topics.DEPTH))
    words = ['-p', 'recorder.out:=bag', '-p', 'recorder.topics:=[number]']
    process = launch(RECORDER, '--ros-args', *words)
    peer.until(publisher.get_subscription_count)
    process.signal(signal.SIGSTOP)
    for k in range(count):
        publisher.publish(Float64(data=float(k)))
    process.signal(signal.SIGCONT)
    peer.until(lambda: heard.get('number') == str(count))
    assert process.end(signal.SIGINT) == 0
    (stream,) = content(tmp_path / 'bag' / 'bag_0.mcap').values()
    values = [deserialize_message(data, Float64).data for _, data in stream]
    assert values == list(map(float, range(count)))


def test_by_hand_the_laws_of_a_controller_are_attached(launch, peer, tmp_path):
    law, gone = tmp_path / 'laws' / 'my_law.py', tmp_path / 'laws' / 'gone.py'
    law.parent.mkdir()
    law.write_text('raise SystemExit("nothing of it is run")')
    controller = rclpy.create_node('controller', context=peer.node.context)
    controller.declare_parameter('custom_laws', [str(law), str(gone)])
    controller.create_publisher(
        message_class(topics.COMMANDS.type), topics.COMMANDS.name, qos_of(topics.COMMANDS)
    )
    peer.node.executor.add_node(controller)
    process = launch(RECORDER, '--ros-args', '-p', 'recorder.out:=bag')
    line = f'/controller: the law file {gone} is not on this machine; the bag does not hold this'
    peer.until(lambda: line in process.stderr)
    assert process.end(signal.SIGINT) == 0 and process.stderr.count(str(gone)) == 1
    sources = bag_reader.read(tmp_path / 'bag', (), print).sources
    assert sources['custom_laws'] == {'my_law': law.read_bytes()}
    controller.destroy_node()


def test_a_wrong_expression_costs_one_line(launch, domain):
    process = launch(RECORDER, '--ros-args', '-p', 'recorder.regex:="(a"')
    assert process.wait() == 2
    assert process.stderr.count('\n') == 1 and 'recorder.regex' in process.stderr
