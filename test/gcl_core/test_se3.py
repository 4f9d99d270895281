import numpy as np
import pytest

from gcl_core import se3


@pytest.fixture
def random_T() -> np.ndarray:
    rng = np.random.default_rng(0)
    return se3.from_xyz_rpy(*rng.normal(size=6))


def test_inverse_composes_to_identity(random_T):
    np.testing.assert_allclose(random_T @ se3.inverse(random_T), np.eye(4), atol=1e-12)


def test_yaw_turns_forward_to_left():
    T = se3.from_xyz_rpy(x=1.0, yaw=np.pi / 2)
    np.testing.assert_allclose(se3.transform(T, np.array([[1.0, 0, 0]])), [[1, 1, 0]], atol=1e-12)


@pytest.mark.parametrize('angle', [0.0, 1e-6, 0.3, np.pi])
def test_rotation_angle(angle):
    assert se3.rotation_angle(se3.from_xyz_rpy(pitch=angle)) == pytest.approx(angle, abs=1e-9)


def test_quaternion_round_trip(random_T):
    rotation = se3.from_quaternion(*se3.to_quaternion(random_T[:3, :3]))
    np.testing.assert_allclose(rotation, random_T[:3, :3], atol=1e-12)
