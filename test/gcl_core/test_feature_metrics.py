"""Inlier ratio, feature-match recall and feature drift on cases that can be counted by hand."""

import numpy as np
import pytest
import torch

from gcl_core import se3
from gcl_core.data.groups import find_groups
from gcl_core.evaluation.feature_metrics import (
    TAU2,
    feature_drift,
    feature_match_recall,
    inlier_ratio,
)
from gcl_core.types import Correspondences

T = se3.from_xyz_rpy(4.0, -2.0, 0.3, yaw=0.8)


def matches(error):
    """Right matches under T, each target then moved by an error along x, metres."""
    rng = np.random.default_rng(0)
    source = rng.uniform(-20, 20, (len(error), 3))
    target = se3.transform(T, source)
    target[:, 0] += error
    points = (torch.from_numpy(p.reshape(-1, 3)).float() for p in (source, target))
    return Correspondences(*points, torch.ones(len(error)))


def test_inlier_ratio():
    assert inlier_ratio(matches(np.zeros(8)), T) == 1.0
    assert inlier_ratio(matches(np.array([0, 0, 0, 9.0])), T) == 0.75
    assert inlier_ratio(matches(np.array([0, 5.0] * 4)), T) == 0.5
    assert inlier_ratio(matches(np.zeros(0)), T) == 0.0
    assert inlier_ratio(matches(np.array([0.05, 0.15])), T, tau1=0.1) == 0.5
    assert inlier_ratio(matches(np.zeros(8)), np.eye(4)) == 0.0


def test_feature_match_recall_needs_more_than_tau2():
    assert feature_match_recall([0.9, 0.06, TAU2, 0.0]) == (2, 4)
    assert feature_match_recall([0.9, 0.06], tau2=0.5) == (1, 2)
    assert feature_match_recall([]) == (0, 0)


@pytest.fixture
def groups():
    """Two spots: of three scans, the second nearest to the first spot; of two scans."""
    points = torch.tensor([[10.0, 0, 0], [20, 0, 0], [4.1, 0, 0], [30, 0, 0], [40, 0, 0]])
    poses = np.stack([se3.from_xyz_rpy(x=x) for x in (0.0, 6.0, -20.0)])
    return find_groups(points, (0, 2, 3, 5), poses, radius=0.45)


def test_the_groups_are_the_two_spots(groups):
    assert groups.member.tolist() == [0, 2, 3, 1, 4]
    assert groups.member[groups.finest].tolist() == [2, 1]


def test_drift_is_zero_where_features_do_not_change(groups):
    assert not feature_drift(torch.ones(5, 4), groups).any()


def test_drift_is_the_distance_from_the_finest(groups):
    descriptors = torch.nn.functional.normalize(torch.rand(5, 8, generator=torch.manual_seed(1)))
    descriptors[3] = -descriptors[2]
    drift = feature_drift(descriptors, groups)
    assert drift[1] == drift[3] == 0.0
    assert drift[0] == pytest.approx(float((descriptors[0] - descriptors[2]).norm()))
    assert drift[2] == pytest.approx(2.0)
    assert drift[4] == pytest.approx(float((descriptors[4] - descriptors[1]).norm()))
