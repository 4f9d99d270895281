"""What the launch files start, and that these nodes come up with the topics that were meant."""

import importlib.util
import sys
from pathlib import Path

import pytest

from gcl_ros.registrar_node import RegistrarNode
from gcl_ros.sender_node import SenderNode

ROOT = Path(__file__).parents[2]
LAUNCH = sorted((ROOT / 'launch').glob('*.launch.py'))
KINDS = {'registrar': RegistrarNode, 'sender': SenderNode}
PROFILE = 'FASTDDS_DEFAULT_PROFILES_FILE'  # where ROS_DISTRO says nothing
NEEDED = {'registrar': {'source': '/b/points', 'target': '/a/points'}, 'replay': {'bag': '/bag'}}


def _load_stand_in():
    path = Path(__file__).with_name('launch_stand_in.py')
    spec = importlib.util.spec_from_file_location('launch_stand_in', path)
    module = sys.modules['launch_stand_in'] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


stand_in = _load_stand_in()


@pytest.fixture(autouse=True)
def no_distribution(monkeypatch):
    monkeypatch.delenv('ROS_DISTRO', raising=False)


def launched(file, /, **arguments):
    """What would be started; the checkout has the layout of the installed share folder."""
    needed = NEEDED.get(file, {})
    return stand_in.launched(ROOT / 'launch' / f'{file}.launch.py', ROOT, **needed | arguments)


def come_up(rig, started):
    """The node as its process would make it, active with odometry; its topics, by direction."""
    arguments = ['--ros-args', *started.ros_arguments]
    kind = KINDS[started.executable]
    settings = {'motion__odometry': True} if kind is RegistrarNode else {}
    node = rig.add(kind, cli_args=arguments, **settings)
    assert node.state == 'active', node.problem
    subscribed = {subscription.topic_name for subscription in node.subscriptions}
    published = {publisher.topic_name for publisher in node.publishers}
    return node, subscribed, published


@pytest.mark.parametrize('path', LAUNCH, ids=lambda p: p.name)
def test_everything_named_exists(path):
    setup = (ROOT / 'setup.py').read_text()
    context = launched(path.name.split('.')[0])
    assert context.started
    assert all(context.declared.values()), 'an argument without a description'
    assert Path(context.environment[PROFILE]).is_file()
    for node in context.started:
        assert node.package == 'gcl_ros'
        assert f"'{node.executable} = gcl_ros." in setup
        for given in node.parameters:
            assert isinstance(given, dict) or Path(given).is_file()


def test_one_registrar(rig):
    context = launched(
        'registrar', namespace='roof', use_sim_time='true', source_odometry='/b/odom'
    )
    (started,) = context.started
    node, subscribed, published = come_up(rig, started)
    wanted = {'/b/points', '/a/points', '/b/odom', '/roof/target/odometry'}
    assert wanted <= subscribed
    assert {'/roof/registrar/transform', '/roof/registrar/pose'} <= published
    assert node.get_parameter('use_sim_time').value


def test_a_node_is_named_told_how_much_to_log_and_started_again_on_request(rig):
    context = launched('registrar', name='roof', log_level='warn', respawn='true')
    (started,) = context.started
    assert started.arguments == ['--ros-args', '--log-level', 'warn']
    assert started.respawn == 'true'
    _, _, published = come_up(rig, started)
    assert '/roof/transform' in published
    for started in launched('both_vehicles', log_level='debug', respawn='true').started:
        assert started.arguments == ['--ros-args', '--log-level', 'debug']
        assert started.respawn == 'true'
    assert {started.respawn for started in launched('both_vehicles').started} == {'false'}


@pytest.mark.parametrize(
    ('distribution', 'key'),
    [
        ('humble', 'FASTRTPS_DEFAULT_PROFILES_FILE'),
        ('jazzy', 'FASTRTPS_DEFAULT_PROFILES_FILE'),
        ('kilted', 'FASTDDS_DEFAULT_PROFILES_FILE'),
    ],
)
@pytest.mark.parametrize('name', ['registrar', 'both_vehicles', 'replay'])
def test_big_clouds_have_room_on_every_distribution(monkeypatch, name, distribution, key):
    monkeypatch.setenv('ROS_DISTRO', distribution)
    environment = launched(name).environment
    assert Path(environment.pop(key)).name == 'fastdds.xml'
    assert not environment


def test_what_is_required_is_asked_for():
    with pytest.raises(RuntimeError, match='"source" was not provided'):
        stand_in.launched(ROOT / 'launch' / 'registrar.launch.py', ROOT)
    with pytest.raises(RuntimeError, match='none of'):
        launched('both_vehicles', only='c')


def test_both_vehicles(rig):
    """Each sees its own points and the other's compact scans, whose topics one launch connects."""
    started = launched('both_vehicles', a='red', b='blue').started
    names = [(node.namespace, node.executable) for node in started]
    assert names == [(own, kind) for own in ('red', 'blue') for kind in ('sender', 'registrar')]
    topics = {name: come_up(rig, node)[1:] for name, node in zip(names[:3], started[:3])}
    subscribed, published = topics['red', 'sender']
    assert '/red/points' in subscribed
    assert '/red/compact' in published
    subscribed, published = topics['red', 'registrar']
    assert {'/red/points', '/blue/compact', '/red/odometry', '/blue/odometry'} <= subscribed
    assert '/red/registrar/transform' in published
    assert '/blue/compact' in topics['blue', 'sender'][1]


@pytest.mark.parametrize(('only', 'namespaces'), [('a', {'vehicle_a'}), ('b', {'vehicle_b'})])
def test_one_of_two_vehicles(only, namespaces):
    assert {node.namespace for node in launched('both_vehicles', only=only).started} == namespaces


def test_a_replay_ends_the_launch_and_has_its_clock(rig):
    context = launched('replay', rate='0.5')
    registrar, replay = context.started
    assert replay.arguments == ['/bag', '--rate', '0.5']
    ((action, follows),) = context.on_exit
    assert action is replay.action
    assert [type(step).__name__ for step in follows] == ['Shutdown']
    node, subscribed, _ = come_up(rig, registrar)
    assert {'/source/points', '/target/points', '/clock'} <= subscribed
    assert node.get_parameter('use_sim_time').value


def test_a_profile_that_is_set_stays(monkeypatch):
    path = ROOT / 'launch' / 'registrar.launch.py'
    context = stand_in.Context({'gcl_ros': ROOT}, dict(NEEDED['registrar']), {PROFILE: '/own.xml'})
    with stand_in.stand_in():
        stand_in.load(path).visit(context)
    assert context.environment[PROFILE] == '/own.xml'


def test_rviz_starts_on_request_with_our_view():
    started = launched('replay', rviz='true').started
    (rviz,) = [node for node in started if node.package == 'rviz2']
    assert rviz.arguments[0] == '-d'
    assert Path(rviz.arguments[1]).is_file()
