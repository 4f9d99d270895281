"""A seeded thousand of the inputs of `make bench-fuzz`, inputs by Hypothesis, and huge claims."""

import os
import struct
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gcl_core.config import load_config
from gcl_core.data.clouds import read_cloud
from gcl_core.errors import GclError
from gcl_core.registrar import RegistrarConfig
from gcl_ros.bag import CLOUD
from gcl_ros.bag_reader import cloud_of, deserialized, message_types
from gcl_ros.conversions import point_cloud
from gcl_ros.fuzz import sandbox, seeds
from gcl_ros.fuzz.mutate import mutated
from gcl_ros.fuzz.targets import targets

TARGETS = targets()
INPUTS = {name: 10 if name.startswith('bag') else 57 for name in TARGETS}  # bags are slow


def test_together_they_are_a_thousand():
    assert sum(INPUTS.values()) >= 1000


@pytest.mark.parametrize('name', TARGETS)
def test_broken_inputs_are_read_or_refused(name, tmp_path):
    target = TARGETS[name]
    whole = target.seeds()
    with sandbox.bounded_memory():
        for number in range(INPUTS[name]):
            rng = np.random.default_rng([1, number])
            data = mutated(whole[number % len(whole)], rng, whole[-1])
            assert sandbox.outcome(target, data, tmp_path) in ('read', 'refused'), number


@pytest.mark.parametrize('name', [name for name in TARGETS if name != 'weights record'])
def test_whole_inputs_are_read(name, tmp_path):
    for data in TARGETS[name].seeds():
        assert sandbox.outcome(TARGETS[name], data, tmp_path) == 'read'


ANYTHING = st.one_of(
    st.binary(max_size=400),
    st.text(max_size=200).map(lambda text: text.encode('utf-8', 'surrogatepass')),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner),
        max_leaves=12,
    ).map(lambda value: str(value).encode('utf-8', 'surrogatepass')),
)


@pytest.mark.parametrize('name', [name for name in TARGETS if not name.startswith('bag')])
@settings(
    max_examples=15,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(data=ANYTHING)
def test_anything_at_all_is_read_or_refused(name, tmp_path, data):
    assert sandbox.outcome(TARGETS[name], data, tmp_path) in ('read', 'refused')


NUMBERS = st.sampled_from([0, 1, 2, 3, 12, 40, 2**16, 2**31, 2**32 - 1])


@settings(max_examples=100, deadline=None, derandomize=True)
@given(data=st.data())
def test_a_message_with_any_numbers_in_it_is_read_or_refused(data):
    types = message_types().types
    message = deserialized(seeds.raw_message(), CLOUD)
    field = types['sensor_msgs/msg/PointField']
    message.fields = [
        field(
            name=data.draw(
                st.sampled_from(['x', 'y', 'z', 't', 'gcl_compact_scan', 'gcl2_0123456789ab', ''])
            ),
            offset=data.draw(NUMBERS),
            datatype=data.draw(st.integers(0, 255)),
            count=data.draw(NUMBERS),
        )
        for _ in range(data.draw(st.integers(0, 4)))
    ] + data.draw(st.sampled_from([[], list(message.fields)]))
    for name in ('width', 'height', 'point_step', 'row_step'):
        if data.draw(st.booleans()):
            setattr(message, name, data.draw(NUMBERS))
    message.data = np.frombuffer(data.draw(st.binary(max_size=600)), np.uint8)
    try:
        found = len(cloud_of(message))
    except GclError:
        return
    assert 0 < found <= 600


def in_child(work) -> int:
    """Exit code of a forked child that may take 128 MB: 0 refused, 1 read, 2 anything else."""
    child = os.fork()
    if child == 0:
        code = 2
        try:
            with sandbox.bounded_memory(128 << 20):
                work()
            code = 1
        except GclError:
            code = 0
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


HUGE = 10**12
NPY = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({HUGE}, 3)}}".ljust(117) + '\n'
CLAIMS = {
    'a.pcd': f'VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {HUGE}\n'
    f'HEIGHT 1\nPOINTS {HUGE}\nDATA ascii\n1 2 3\n'.encode(),
    'b.pcd': f'VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {HUGE}\n'
    f'HEIGHT 1\nPOINTS {HUGE}\nDATA binary\n'.encode()
    + bytes(1200),
    'a.ply': f'ply\nformat ascii 1.0\nelement vertex {HUGE}\nproperty float x\nproperty float y\n'
    'property float z\nend_header\n1 2 3\n'.encode(),
    'b.ply': f'ply\nformat binary_little_endian 1.0\nelement vertex {HUGE}\nproperty float x\n'
    'property float y\nproperty float z\nend_header\n'.encode()
    + bytes(1200),
    'a.npy': b'\x93NUMPY\x01\x00' + struct.pack('<H', len(NPY)) + NPY.encode() + bytes(1200),
}


@pytest.mark.parametrize('name', CLAIMS)
def test_a_header_that_claims_a_trillion_points_is_refused_before_memory_is_taken(name, tmp_path):
    path = tmp_path / name
    path.write_bytes(CLAIMS[name])
    with pytest.raises(GclError, match=r'claims 10000|not a \.npy file'):
        read_cloud(path)
    assert in_child(lambda: read_cloud(path)) == 0


def test_a_message_that_claims_billions_of_points_is_refused_before_memory_is_taken():
    message = deserialized(seeds.raw_message(), CLOUD)
    message.width = message.height = 2**32 - 1
    assert in_child(lambda: point_cloud(message)) == 0


@pytest.mark.parametrize('kind', ['pcd', 'ply'])
@pytest.mark.parametrize('share', [0.3, 0.8, 0.99])
def test_no_point_is_made_up_where_a_text_file_is_cut_off(kind, share, tmp_path):
    whole = getattr(seeds, kind)('ascii')
    begin = whole.index(b'\n', whole.index(b'DATA' if kind == 'pcd' else b'end_header')) + 1
    path = tmp_path / f'c.{kind}'
    path.write_bytes(whole)
    np.testing.assert_allclose(read_cloud(path).points, seeds.cloud().points, rtol=1e-4)
    path.write_bytes(whole[: begin + int(share * (len(whole) - begin))])
    with pytest.raises(GclError, match=r'cut off|holds no point'):
        read_cloud(path)


def test_references_that_would_fill_the_memory_are_refused(tmp_path):
    """A YAML file of ten parts whose value, printed, would have 10^10 elements."""
    parts = ['&a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]']
    for low, high in pairwise('abcdefghij'):
        parts.append(f'&{high} [{", ".join([f"*{low}"] * 10)}]')
    path = tmp_path / 'laughs.yaml'
    path.write_text(f'headings: [{", ".join(parts)}]\n')
    assert in_child(lambda: load_config(RegistrarConfig, path)) == 0
