"""The trainer on a tiny network: it learns, logs, and resumes to the same weights."""

import json
import subprocess
import sys
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch
import yaml
from scipy.spatial import cKDTree

from gcl_core import se3
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError
from gcl_core.files import sha256
from gcl_core.losses.combined import LossConfig
from gcl_core.models.kpconv_resunet import KPConvConfig
from gcl_core.models.resunet import ResUNet, ResUNetConfig
from gcl_core.models.zoo import save_weights
from gcl_core.training import neighbor_limits
from gcl_core.training.distributed import Processes
from gcl_core.training.recipe import GroupConfig, OptimizerConfig, TrainConfig
from gcl_core.training.samples import SampleConfig, SampleStream, augment
from gcl_core.training.simulated import SimulatedGroups, SimulationConfig
from gcl_core.training.trainer import Trainer
from gcl_core.training.validation import top1, validate
from gcl_core.types import PositiveGroups

CONFIG = TrainConfig(
    network=ResUNetConfig(
        voxel_size=0.6, max_range=25.0, encoder=(4, 8, 8, 8), decoder=(8, 8), head=8
    ),
    samples=SampleConfig(
        simulation=SimulationConfig(samples_per_world=100, sensors=('hdl32e',)),
        phi=2,
        yaw_deg=(10.0, 10.0),
    ),
    groups=GroupConfig(count=128),
    loss=LossConfig(gcl_from=0.25),
    optimizer=OptimizerConfig(warmup=1, average=0.5),
    steps=4,
    bf16=False,
    save_every=2,
)


KPCONV = replace(
    CONFIG,
    network=KPConvConfig(voxel_size=0.6, max_range=25.0, width=8, output_level=1),
    loss=replace(CONFIG.loss, pair=1.0, variance=0.0),
)
BOTH = pytest.mark.parametrize('recipe', [CONFIG, KPCONV], ids=['conv', 'kpconv'])


@pytest.fixture
def one_thread():
    """Sums of several threads depend on how many were free, in torch's own products."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@BOTH
@pytest.mark.usefixtures('one_thread')
def test_resumed_run_ends_at_the_same_weights(tmp_path, recipe):
    whole = Trainer(recipe, tmp_path / 'whole')
    whole.run()
    rows = [json.loads(line) for line in (tmp_path / 'whole/log.jsonl').open()]
    assert [row['step'] for row in rows] == [1, 2, 3, 4]
    positive = 'variance' if recipe.loss.variance else 'pair'
    assert {'contrast', positive, 'finest', 'negative'} <= set(rows[-1])

    broken = Trainer(recipe, tmp_path / 'broken')
    stream = SampleStream(recipe.samples, recipe.network, recipe.seed, range(2), recipe.steps)
    for sample in stream:
        broken.train_step([sample])
    broken.save()
    # Of steps after the checkpoint, the last of them cut off by a kill.
    (tmp_path / 'broken/log.jsonl').write_text('{"step": 2}\n{"step": 3}\n{"st')
    resumed = Trainer(recipe, tmp_path / 'broken')
    assert resumed.step == 2
    resumed.run()
    assert [row['step'] for row in logged(tmp_path / 'broken')] == [2, 3, 4]
    for (name, a), b in zip(
        whole.shipped.state_dict().items(), resumed.shipped.state_dict().values(), strict=True
    ):
        torch.testing.assert_close(a, b, msg=name)


@BOTH
def test_loss_falls_on_one_sample(tmp_path, recipe):
    optimizer = OptimizerConfig(learning_rate=5e-3, warmup=3)
    config = replace(recipe, steps=30, optimizer=optimizer, loss=LossConfig())
    trainer = Trainer(config, tmp_path)
    sample = next(iter(SampleStream(config.samples, config.network, 1, range(1), 1)))
    losses = [trainer.train_step([sample])['contrast'] for _ in range(15)]
    assert losses[-1] < losses[0] - 0.5


def test_a_run_goes_on_with_the_samples_that_it_began_with(tmp_path):
    Trainer(CONFIG, tmp_path).save()
    other = replace(CONFIG, steps=9, loss=LossConfig(pair=1.0))
    assert Trainer(other, tmp_path).step == 0
    ended = Trainer(CONFIG, tmp_path / 'ended')
    ended.step = CONFIG.steps
    ended.save()
    with pytest.raises(GclError, match='of a run with other loss; set'):
        Trainer(replace(other, steps=CONFIG.steps), tmp_path / 'ended')
    simulation = replace(CONFIG.samples.simulation, sensors=('vlp16',))
    for change, name in (
        ({'seed': 2}, 'seed'),
        ({'batch': 2}, 'batch'),
        ({'samples': replace(CONFIG.samples, simulation=simulation)}, 'samples'),
        ({'network': replace(CONFIG.network, voxel_size=0.3)}, 'network'),
    ):
        with pytest.raises(GclError, match=f'of a run with other {name}; set'):
            Trainer(replace(CONFIG, **change), tmp_path)


def test_a_run_can_start_from_weights(tmp_path):
    first = Trainer(CONFIG, tmp_path / 'first')
    held = tmp_path / 'first/weights.safetensors'
    save_weights(held, first.model, {})
    config = replace(CONFIG, seed=2, start=str(held))
    trainer = Trainer(config, tmp_path / 'second')
    for model in (trainer.model, trainer.shipped):
        for name, tensor in model.state_dict().items():
            torch.testing.assert_close(tensor, first.model.state_dict()[name], msg=name)
    trainer.save()
    began = sha256(held)
    held.write_bytes(b'other weights, put there between two sittings')
    assert Trainer(config, tmp_path / 'second').start_sha256 == trainer.start_sha256 == began
    with pytest.raises(GclError, match='of a run with other start; set'):
        Trainer(replace(config, start=''), tmp_path / 'second')


@pytest.mark.parametrize(
    ('weights', 'named'), [('gcl_conv', '.*voxel_size.*'), ('gcl_kpconv', 'backbone')]
)
def test_weights_of_another_network_are_no_start(tmp_path, weights, named):
    with pytest.raises(GclError, match=f'whose network has other {named}; set network'):
        Trainer(replace(CONFIG, start=weights), tmp_path)


@pytest.mark.parametrize('seed', [-1, 700])
def test_worlds_of_calibration_and_tests_are_not_trained_on(seed):
    with pytest.raises(GclError, match=f'seed is {seed}; it must lie in 0 to 699'):
        replace(CONFIG, seed=seed)


def test_the_nearest_feature_is_right_if_it_is_of_the_group():
    """Two members of one group in the other scan: either will do."""
    group = [0, 1, 2]  # a point of the centre, two of its neighbour
    groups = PositiveGroups(
        offsets=torch.tensor([0, 3]),
        member=torch.tensor(group),
        sensor_range=torch.ones(3),
        finest=torch.tensor([0]),
        anchor=torch.zeros(1, 3).double(),
    )
    features = torch.tensor([[1.0, 0.0], [1.0, 0.1], [0.6, 0.8], [0.0, 1.0]])
    assert top1(features, groups, (0, 1, 4)) == 1.0
    assert top1(features[[0, 3, 2, 1]], groups, (0, 1, 4)) == 0.0


def logged(folder):
    return [json.loads(line) for line in (folder / 'log.jsonl').open()]


def save_yaml(path, config):
    path.write_text(yaml.safe_dump(json.loads(json.dumps(asdict(config)))))


def test_two_processes_take_the_steps_of_one(tmp_path):
    # Plain SGD: Adam's first steps turn a difference in the last bit into one of a per cent.
    sgd = OptimizerConfig(name='sgd', learning_rate=0.1, warmup=1)
    config = replace(CONFIG, batch=2, steps=3, optimizer=sgd)
    save_yaml(tmp_path / 'recipe.yaml', config)
    Trainer(config, tmp_path / 'one').run()
    launch = [sys.executable, '-m', 'torch.distributed.run', '--standalone', '--nproc_per_node=2']
    command = ['-m', 'gcl_core.cli.main', 'train', '--config', str(tmp_path / 'recipe.yaml')]
    subprocess.run([*launch, *command, '--out', str(tmp_path / 'two')], check=True, timeout=100)
    one, two = logged(tmp_path / 'one'), logged(tmp_path / 'two')
    assert [row['step'] for row in two] == [1, 2, 3]
    assert two[0]['loss'] == pytest.approx(one[0]['loss'], rel=1e-5)
    for a, b in zip(one, two, strict=True):  # rounding grows from step to step
        assert b['loss'] == pytest.approx(a['loss'], rel=1e-2)
        assert b['gradient'] == pytest.approx(a['gradient'], rel=1e-2)


def test_a_batch_that_cannot_be_shared_is_refused():
    with pytest.raises(GclError, match='multiple of 2'):
        Processes(rank=0, count=2).share(3)


def test_recorded_drives_and_pair_stages(tmp_path, write_folder):
    street = SimulatedSequence(5, sensor='hdl32e', span=60.0, spacing=2.0)
    write_folder(tmp_path, street, range(len(street)))
    samples = SampleConfig(data=str(tmp_path), phi=2, pair_stages=((5, 10), (20, 25)))
    stream = list(SampleStream(samples, CONFIG.network, 1, range(4), 4))
    away = [np.linalg.norm(sample.T_centre_scan[1, :3, 3]) for sample in stream]
    assert [len(sample.T_centre_scan) for sample in stream] == [2, 2, 2, 2]
    assert all(4.5 < a < 10.5 for a in away[:2])
    assert all(19.5 < a < 25.5 for a in away[2:])
    loss = LossConfig(contrast=0, variance=0, finest=0, pair=1, negative=1, gcl_from=0)
    trainer = Trainer(replace(CONFIG, samples=samples, loss=loss), tmp_path / 'run')
    row = trainer.train_step([stream[0]])
    assert {'pair', 'negative'} <= set(row)


@pytest.mark.parametrize('route', ['along', 'oncoming'])
def test_augmented_scans_stay_where_their_poses_say(route):
    """Points of all scans, brought to the centre's frame, lie on the centre's own."""
    config = SampleConfig(
        simulation=SimulationConfig(sensors=('hdl64e',), oncoming=float(route == 'oncoming')),
        phi=2,
        keep=0.5,
    )
    group = SimulatedGroups(config.simulation, 2).group(3, seed=1)
    clouds, poses = augment(group, config, 0.5, np.random.default_rng(0))
    tree = cKDTree(group.clouds[0].points)
    for cloud, pose in zip(clouds, poses, strict=True):
        aligned = se3.transform(pose, cloud.points)
        away = np.linalg.norm(aligned[:, :2], axis=1)
        near = aligned[(away > 5) & (away < 15)]
        assert len(near) > 20
        assert np.median(tree.query(near)[0]) < 0.3
    headings = [np.arctan2(T[1, 0], T[0, 0]) for T in poses]
    turned = [abs(np.angle(np.exp(1j * (h - headings[0])))) for h in headings[1:]]
    assert (np.rad2deg(turned) < 50).all()  # also what drove the other way


def test_validation_says_how_good_features_are_by_distance():
    torch.manual_seed(0)
    figures = validate(ResUNet(CONFIG.network).eval())
    assert {'valid/inliers_5_10', 'valid/recall_40_50'} <= set(figures)
    assert all(0 <= value <= 1 for value in figures.values())


@pytest.mark.parametrize(
    ('cooldown', 'rates'), [(1.0, (1.0, 0.505, 0.01)), (0.5, (1.0, 1.0, 0.01))]
)
def test_learning_rate(cooldown, rates):
    config = OptimizerConfig(learning_rate=1.0, warmup=0, cooldown=cooldown)
    assert [config.rate(step, 100) for step in (0, 50, 100)] == pytest.approx(rates)


def test_cached_samples_are_the_same_and_stay_within_the_limit(tmp_path):
    def stream(cache):
        return SampleStream(CONFIG.samples, CONFIG.network, 1, range(3), 3, cache=cache)

    plain = list(stream(None))
    for _ in range(2):
        for a, b in zip(plain, stream((tmp_path, 1.0)), strict=True):
            assert torch.equal(a.inputs.keys, b.inputs.keys)
            assert a.inputs.splits == b.inputs.splits
            np.testing.assert_array_equal(a.T_centre_scan, b.T_centre_scan)
    files = sorted(tmp_path.rglob('*.safetensors'))
    assert len(files) == 3
    files[0].write_bytes(b'damaged')
    assert torch.equal(next(iter(stream((tmp_path, 1.0)))).inputs.keys, plain[0].inputs.keys)
    limit = 2.5 * files[1].stat().st_size / 1e9
    files[0].unlink()
    list(stream((tmp_path, limit)))
    assert len(list(tmp_path.rglob('*.safetensors'))) == 2


def test_neighbour_limits_are_counted_from_a_recipe(tmp_path, capsys):
    for name, recipe in (('kpconv', KPCONV), ('conv', CONFIG)):
        save_yaml(tmp_path / f'{name}.yaml', recipe)
    arguments = ['--scans', '1', '--config']
    neighbor_limits.main([*arguments, str(tmp_path / 'kpconv.yaml')])
    limits = yaml.safe_load(capsys.readouterr().out)['limits']
    replace(KPCONV.network, limits=tuple(limits))  # as many as it has levels, all positive
    with pytest.raises(SystemExit, match='2'):
        neighbor_limits.main([*arguments, str(tmp_path / 'conv.yaml')])
    assert 'network.backbone is not kpconv' in capsys.readouterr().err
