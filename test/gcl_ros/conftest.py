"""Nodes over real DDS in a domain of their own, and clouds with something wrong about them."""

import random
import threading
import time

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2, PointField
from std_srvs.srv import Trigger

from gcl_core import se3
from gcl_ros.bench_stream import make
from gcl_ros.conversions import fill_point_cloud2
from gcl_ros.transport import PROFILE, read_here

PATIENCE = 60.0  # seconds, on a machine that is busy with something else


class Rig:
    """Nodes of one process in a DDS domain of their own, spun by one thread."""

    def __init__(self) -> None:
        self.context = Context()
        self.domain = random.randint(1, 100)
        rclpy.init(context=self.context, domain_id=self.domain)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.node = Node('vehicles', context=self.context)
        self.executor.add_node(self.node)
        self.publishers: dict = {}
        self.stamp = 0.0
        self.offset = {'source': 0.0, 'target': 0.0}
        self.status = None
        self._nodes = [self.node]
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._diagnosed, 10)
        self._spinning = threading.Thread(target=self._spin)
        self._open = True
        self._spinning.start()

    def _spin(self) -> None:
        while self._open:
            self.executor.spin_once(timeout_sec=0.05)

    def _diagnosed(self, message) -> None:
        self.status = message.status[0]

    def make(self, kind, *, cli_args=None, **parameters):
        """Make a node of this kind; `__` in a parameter's name stands for a dot."""
        overrides = [
            Parameter(name.replace('__', '.'), value=value) for name, value in parameters.items()
        ]
        node = kind(context=self.context, parameter_overrides=overrides, cli_args=cli_args)
        self._nodes.append(node)
        return node

    def add(self, kind, *, start=True, **settings):
        """Make a node, start it and spin it."""
        node = self.make(kind, **settings)
        if start:
            node.start()
        self.executor.add_node(node)
        return node

    def listen(self, kind, topic) -> list:
        """The list that messages of a topic will come into."""
        heard: list = []
        self.node.create_subscription(kind, topic, heard.append, 10)
        return heard

    def publish_clouds(self, reliability=ReliabilityPolicy.RELIABLE) -> None:
        """Create the publishers of both sides anew."""
        for publisher in self.publishers.values():
            self.node.destroy_publisher(publisher)
        qos = QoSProfile(depth=1, reliability=reliability)
        self.publishers = {
            side: self.node.create_publisher(PointCloud2, f'/{side}/points', qos)
            for side in ('source', 'target')
        }

    def send(self, **clouds) -> None:
        """Publish clouds, as points or as messages, with the next stamp."""
        self.stamp += 1.0
        for side, cloud in clouds.items():
            message = cloud
            if isinstance(cloud, np.ndarray):
                message = fill_point_cloud2(PointCloud2(), cloud, PointField)
            stamp = self.stamp + self.offset[side]
            message.header.stamp.sec = int(stamp)
            message.header.stamp.nanosec = round(stamp % 1 * 1e9)
            message.header.frame_id = f'{side}_lidar'
            self.publishers[side].publish(message)

    def until(self, condition, *, every=None, pause=1.0, patience=PATIENCE) -> bool:
        """Wait for something to happen, doing `every` again and again."""
        deadline, due = time.monotonic() + patience, 0.0
        while time.monotonic() < deadline:
            if condition():
                return True
            if every and time.monotonic() > due:
                every()
                due = time.monotonic() + pause
            time.sleep(0.02)
        return False

    def call(self, kind, service, request=None):
        """Call a service; again after a while, for an answer is lost if it comes too soon.

        A client that sees its service may not be seen by it yet.
        """
        client = self.node.create_client(kind, service)
        assert self.until(client.service_is_ready), service
        futures = []
        self.until(
            lambda: any(future.done() for future in futures),
            every=lambda: futures.append(client.call_async(request or kind.Request())),
            pause=PATIENCE / 3,
        )
        answers = [future.result() for future in futures if future.done()]
        assert answers, service
        self.node.destroy_client(client)
        return answers[0]

    def trigger(self, name):
        return self.call(Trigger, f'/registrar/{name}')

    def change(self, transition, node='registrar') -> bool:
        """Ask for a transition, by its number or its name."""
        request = ChangeState.Request()
        key = 'label' if isinstance(transition, str) else 'id'
        request.transition = Transition(**{key: transition})
        return self.call(ChangeState, f'/{node}/change_state', request).success

    def set(self, name, value, node='registrar'):
        """Set a parameter."""
        request = SetParameters.Request()
        request.parameters = [Parameter(name, value=value).to_parameter_msg()]
        return self.call(SetParameters, f'/{node}/set_parameters', request).results[0]

    def says(self, text) -> bool:
        """Whether the diagnostics say something."""
        return self.status is not None and text in self.status.message

    def figures(self) -> dict:
        """Of the last diagnostics; none before the first."""
        return {value.key: value.value for value in self.status.values} if self.status else {}

    def close(self) -> None:
        self._open = False
        self._spinning.join()
        for node in self._nodes:
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def rig(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setenv(read_here()[0], str(PROFILE))
    made = Rig()
    yield made
    made.close()


@pytest.fixture(scope='session')
def meeting(drive):
    """Thinned clouds of two vehicles 8 m apart, and where the source stands."""
    T = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(98)
    return drive.scan(98).points[::3], drive.scan(90).points[::3], T


@pytest.fixture(scope='session')
def streams(tmp_path_factory):
    """Folder with the clouds of two vehicles that meet, for `gcl_ros.bench_stream`."""
    path = tmp_path_factory.mktemp('streams')
    make(path)
    return path


@pytest.fixture(scope='session')
def malformed():
    """Function of a seed."""
    return make_malformed


def make_malformed(seed: int) -> PointCloud2:
    """A cloud with one to three things about it drawn at random."""
    rng = np.random.default_rng(seed)
    m = fill_point_cloud2(PointCloud2(), rng.normal(size=(64, 3)), PointField)
    m.header.frame_id = rng.choice(['', 'lidar', 'ä/\n'])
    pick = lambda: rng.integers(len(m.fields))  # noqa: E731
    number = lambda: int(rng.choice([0, 1, 3, 7, 64, 65, 255, 2**16, 2**31, 2**32 - 1]))  # noqa: E731
    changes = [
        lambda: setattr(m, 'width', number()),
        lambda: setattr(m, 'height', number()),
        lambda: setattr(m, 'point_step', number()),
        lambda: setattr(m, 'row_step', number()),
        lambda: setattr(m, 'data', rng.bytes(int(rng.integers(0, 2000)))),
        lambda: setattr(m, 'is_bigendian', True),
        lambda: setattr(m.fields[pick()], 'offset', number()),
        lambda: setattr(m.fields[pick()], 'datatype', int(rng.integers(0, 256))),
        lambda: setattr(m.fields[pick()], 'count', number()),
        lambda: setattr(m.fields[pick()], 'name', str(rng.choice(['', 'x', 'rgb']))),
        lambda: setattr(m, 'fields', m.fields[: pick()]),
        lambda: setattr(m, 'fields', [*m.fields, *m.fields]),
    ]
    for i in rng.choice(len(changes), size=rng.integers(1, 4), replace=False):
        if m.fields:
            changes[i]()
    return m
