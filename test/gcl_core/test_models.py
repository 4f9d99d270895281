import json
import subprocess
import sys
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.evaluation import metrics
from gcl_core.models import zoo
from gcl_core.models.kpconv_resunet import KPConvConfig
from gcl_core.models.resunet import ResUNetConfig
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.training.neighbor_limits import calibrated
from gcl_core.types import PointCloud


def parameters(config: zoo.NetworkConfig) -> int:
    return sum(p.numel() for p in zoo.build(config).parameters())


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
    stride = 2**tiny_network.config.output_level
    assert float(apart.max()) < tiny_network.config.voxel_size * stride


def test_a_scan_is_described_the_same_alone_and_in_a_batch(tiny_network):
    rng = np.random.default_rng(1)
    clouds = [PointCloud(rng.uniform(-4, 4, (n, 3)).astype(np.float32)) for n in (300, 200)]
    model = tiny_network.eval()
    together = model.describe(clouds)
    for alone, batched in zip([model.describe([c])[0] for c in clouds], together, strict=True):
        torch.testing.assert_close(alone.points, batched.points)
        torch.testing.assert_close(alone.descriptors, batched.descriptors, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize('yaw', [0.0, 0.3])
def test_a_scan_is_described_as_turned_and_keeps_its_frame(tiny_network, yaw):
    points = np.random.default_rng(2).uniform(-4, 4, (300, 3)).astype(np.float32)
    model = tiny_network.eval()
    headings = model.describe_headings(PointCloud(points), yaw)
    assert [h.yaw for h in headings] == pytest.approx([yaw + k * np.pi / 2 for k in range(4)])
    for heading in headings:
        T_turned_lidar = se3.from_xyz_rpy(yaw=heading.yaw)
        (expected,) = model.describe([PointCloud(se3.transform(T_turned_lidar, points))])
        own = torch.from_numpy(se3.transform(se3.inverse(T_turned_lidar), expected.points.numpy()))
        found = heading.features
        same = torch.cdist(found.points, own).argmin(1)
        assert len(same.unique()) == len(expected)
        torch.testing.assert_close(found.points, own[same], atol=1e-5, rtol=0)
        wanted = expected.descriptors[same]
        torch.testing.assert_close(found.descriptors, wanted, atol=1e-3, rtol=0)


def test_what_is_folded_for_inference_changes_nothing(tiny_network):
    points = np.random.default_rng(3).uniform(-4, 4, (300, 3)).astype(np.float32)
    for norm in (m for m in tiny_network.modules() if isinstance(m, torch.nn.BatchNorm1d)):
        torch.nn.init.uniform_(norm.running_mean)
        torch.nn.init.uniform_(norm.running_var, 0.5, 2.0)
        torch.nn.init.uniform_(norm.bias)
    model = tiny_network.eval()
    inputs = model.prepare(model.voxelize([PointCloud(points)]))
    _, unfolded, _ = model(inputs)
    (folded,) = model.describe_prepared(inputs)
    torch.testing.assert_close(folded.descriptors, unfolded.detach(), atol=1e-5, rtol=1e-4)


def test_one_point_is_described(tiny_network):
    features = tiny_network.eval().describe([PointCloud(np.ones((1, 3), np.float32))])[0]
    assert len(features) == 1


def test_weights_round_trip_and_refuse_damage(tmp_path, tiny_network):
    path = tmp_path / 'w.safetensors'
    zoo.save_weights(path, tiny_network, {'seed': 1})
    restored = zoo.load_weights(str(path))
    assert restored.config == tiny_network.config
    for name, tensor in tiny_network.state_dict().items():
        torch.testing.assert_close(restored.state_dict()[name], tensor, msg=name)
    cloud = PointCloud(np.random.default_rng(2).uniform(-3, 3, (200, 3)).astype(np.float32))
    ours, theirs = (m.eval().describe([cloud])[0] for m in (tiny_network, restored))
    torch.testing.assert_close(theirs.descriptors, ours.descriptors)
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    with pytest.raises(GclError, match='sha256'):
        zoo.load_weights(str(path))


def test_weights_are_loaded_without_torchs_compiler():
    """It takes a second to import, and nothing here compiles."""
    code = (
        'import sys; from gcl_core.models import zoo; zoo.load_weights()\n'
        'print("torch._dynamo" in sys.modules)'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ['False']


def test_missing_and_foreign_weights_are_named(tmp_path):
    with pytest.raises(GclError, match="no weights 'nope'"):
        zoo.load_weights('nope')
    broken = tmp_path / 'b.safetensors'
    broken.write_bytes(b'not safetensors')
    with pytest.raises(GclError, match='not a safetensors file'):
        zoo.load_weights(str(broken))


SHIPPED = sorted(path.stem for path in zoo.FOLDER.glob('*.safetensors'))


def test_both_backbones_are_shipped_within_40_mb():
    assert zoo.DEFAULT in SHIPPED
    assert {zoo.load_weights(name).config.backbone for name in SHIPPED} == {'conv', 'kpconv'}
    assert sum(path.stat().st_size for path in zoo.FOLDER.iterdir()) < 40e6


@pytest.mark.parametrize('name', SHIPPED)
def test_shipped_weights_have_a_record(name):
    model = zoo.load_weights(name)
    card = json.loads((zoo.FOLDER / f'{name}.json').read_text())
    assert card['network']['voxel_size'] == model.config.voxel_size
    assert {'sha256', 'recipe', 'steps', 'data', 'minutes', 'held_out'} <= set(card)


def test_a_network_without_a_backbone_is_conv(tmp_path, monkeypatch):
    """Weights from before there were two."""
    config = ResUNetConfig(encoder=(2, 2, 2, 2), decoder=(2, 2, 2), head=2, descriptor=2)
    written = asdict(config)
    del written['backbone']
    monkeypatch.setattr(zoo, 'asdict', lambda _: written)
    zoo.save_weights(tmp_path / 'old.safetensors', zoo.build(config), {})
    assert zoo.load_weights(str(tmp_path / 'old.safetensors')).config == config


def test_untrained_networks_register_a_scan_with_itself(tmp_path, tiny_network, drive):
    """Registrar and both backbones: the same code, whichever network the weights name."""
    path = tmp_path / 'w.safetensors'
    zoo.save_weights(path, tiny_network, {})
    registrar = Registrar(RegistrarConfig(weights=str(path), headings=1))
    points = drive.scan(90).points
    scan = PointCloud(points[np.linalg.norm(points, axis=1) < 12.0])
    result = registrar.register(source=scan, target=scan)
    assert metrics.registered(result.T_target_source, np.eye(4), metrics.STRICT)
    far = PointCloud(np.full((10, 3), 1000.0, np.float32))
    with pytest.raises(GclError, match='within 80 m'):
        registrar.register(source=far, target=scan)


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'limits': (60, 60)}, 'one positive number for each of 4'),
        ({'output_level': 3}, 'choose from 0 to 2'),
        ({'width': 1}, 'width is 1'),
    ],
)
def test_bad_kpconv_configs_are_named(values, message):
    with pytest.raises(GclError, match=message):
        KPConvConfig(**values)


def test_calibrated_limits_keep_four_fifths_of_the_points_whole(drive):
    config = calibrated(KPConvConfig(limits=(1, 1, 1, 1)), [drive.scan(90)])
    model = zoo.build(replace(config, limits=tuple(limit + 1 for limit in config.limits)))
    pyramid = model.prepare(model.voxelize([drive.scan(90)]))
    for table in pyramid.same:
        cut = (table[:, -1] < len(table)).float().mean()
        assert 0.1 < float(cut) <= 0.2
