import json

import numpy as np
import pytest
import torch

from gcl_core.errors import GclError
from gcl_core.models import zoo
from gcl_core.models.resunet import ResUNet, ResUNetConfig
from gcl_core.types import PointCloud


def parameters(config: ResUNetConfig) -> int:
    return sum(p.numel() for p in ResUNet(config).parameters())


def test_sizes_of_the_paper_and_of_fcgf():
    assert parameters(ResUNetConfig()) == pytest.approx(15e6, rel=0.1)
    fcgf = ResUNetConfig(decoder=(128, 64, 64), head=64)
    assert parameters(fcgf) == pytest.approx(8.75e6, rel=0.01)


def test_describe_gives_unit_descriptors_at_the_points(tiny_network):
    points = np.random.default_rng(0).uniform(-5, 5, (500, 3)).astype(np.float32)
    features = tiny_network.eval().describe([PointCloud(points)])[0]
    assert features.points.shape[0] == features.descriptors.shape[0] > 0
    torch.testing.assert_close(features.descriptors.norm(dim=1), torch.ones(len(features)))
    apart = torch.cdist(features.points, torch.from_numpy(points)).min(1).values
    assert float(apart.max()) < tiny_network.config.voxel_size


def test_a_scan_is_described_the_same_alone_and_in_a_batch(tiny_network):
    rng = np.random.default_rng(1)
    clouds = [PointCloud(rng.uniform(-4, 4, (n, 3)).astype(np.float32)) for n in (300, 200)]
    model = tiny_network.eval()
    together = model.describe(clouds)
    for alone, batched in zip([model.describe([c])[0] for c in clouds], together, strict=True):
        torch.testing.assert_close(alone.points, batched.points)
        torch.testing.assert_close(alone.descriptors, batched.descriptors, atol=1e-5, rtol=1e-4)


def test_one_point_is_described(tiny_network):
    features = tiny_network.eval().describe([PointCloud(np.ones((1, 3), np.float32))])[0]
    assert len(features) == 1


def test_weights_round_trip_and_refuse_damage(tmp_path, tiny_network):
    path = tmp_path / 'w.safetensors'
    zoo.save_weights(path, tiny_network, {'seed': 1})
    restored = zoo.load_weights(str(path))
    assert restored.config == tiny_network.config
    torch.testing.assert_close(restored.stem.conv.weight, tiny_network.stem.conv.weight)
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    with pytest.raises(GclError, match='sha256'):
        zoo.load_weights(str(path))


def test_missing_and_foreign_weights_are_named(tmp_path):
    with pytest.raises(GclError, match="no weights 'nope'"):
        zoo.load_weights('nope')
    broken = tmp_path / 'b.safetensors'
    broken.write_bytes(b'not safetensors')
    with pytest.raises(GclError, match='not a safetensors file'):
        zoo.load_weights(str(broken))


def test_shipped_weights_have_a_record():
    model = zoo.load_weights()
    card = json.loads((zoo.FOLDER / f'{zoo.DEFAULT}.json').read_text())
    assert card['network']['voxel_size'] == model.config.voxel_size
    assert {'sha256', 'recipe', 'steps', 'data'} <= set(card)
