"""What a radio loses or brings too late costs its pair, over real DDS, and nothing else."""

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core.compact.scan import encode
from gcl_core.evaluation import metrics
from gcl_core.types import PointCloud
from gcl_ros.compact_cloud import fill_compact
from gcl_ros.conversions import matrix, seconds
from gcl_ros.registrar_node import RegistrarNode

APART = 0.25  # seconds between scans; what is late comes after its successor


@pytest.mark.parametrize('side', ['source', 'target'])
@pytest.mark.parametrize('late', [False, True], ids=['never', 'late'])
def test_every_second_scan_lost_costs_every_second_pair(rig, meeting, side, late):
    node = rig.add(RegistrarNode, registrar__headings=1)
    rig.publish_clouds()
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    sent = fill_compact(PointCloud2(), encode(PointCloud(meeting[0])), PointField)
    scans = {'source': sent, 'target': meeting[1]}

    def send(number, *sides):
        rig.stamp = 100.0 + number * APART - 1.0  # `send` adds the second
        rig.send(**{each: scans[each] for each in sides})

    def answered(number):
        stamps = [seconds(transform.header.stamp) for transform in transforms]
        return any(np.isclose(stamp, 100.0 + number * APART) for stamp in stamps)

    number = 0

    def whole():
        nonlocal number
        number += 2
        send(number, 'source', 'target')

    assert rig.until(lambda: transforms, every=whole, pause=2.0)
    assert rig.until(lambda: answered(number)), rig.status  # none is at work any more
    assert rig.until(lambda: rig.figures().get('accepted') == str(len(transforms)))
    heard = {each: int(rig.figures()[f'{each} clouds']) for each in scans}

    def send_alone(number, each, more):
        """Send one scan; the node has taken it, and `more` others since, before this returns."""
        send(number, each)
        heard[each] += 1 + more
        assert rig.until(lambda: rig.figures()[f'{each} clouds'] == str(heard[each])), heard

    alone = lambda: int(rig.figures()['clouds without partner'])  # noqa: E731
    before = alone()  # of the time in which the node was not known to both
    first = number
    other = {'source': 'target', 'target': 'source'}[side]
    for lost in range(first + 1, first + 8, 2):
        send_alone(lost, other, more=lost > first + 1)
        send(lost + 1, 'source', 'target')
        assert rig.until(lambda n=lost + 1: answered(n)), rig.status
        if late:
            send_alone(lost, side, more=1)
    send(first + 10, 'source', 'target')
    assert rig.until(lambda: answered(first + 10)), rig.status
    assert not any(answered(lost) for lost in range(first + 1, first + 8, 2))
    assert all(
        metrics.registered(matrix(t.transform), meeting[2], metrics.STRICT) for t in transforms
    )
    assert rig.until(lambda: alone() - before == (8 if late else 4), patience=10), (
        before,
        alone(),
    )
    assert rig.figures()['left out'] == '0'
    assert rig.figures().get('jumps back in time', '0') == '0'
    assert node.state == 'active'
