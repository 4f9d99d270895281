"""What another version wrote, or somebody broke, is refused with both versions named."""

import json
import os
import resource

import pytest
import torch
from safetensors.torch import load_file, save_file

from gcl_core.errors import GclError
from gcl_core.estimation.confidence import load_calibration
from gcl_core.files import whole_file, write_text
from gcl_core.models import zoo
from gcl_core.models.resunet import ResUNetConfig
from gcl_core.training import checkpoint
from gcl_core.types import PointCloud

TINY = ResUNetConfig(encoder=(2, 2, 2, 2), decoder=(2, 2, 2), head=2, descriptor=2)


def state() -> checkpoint.State:
    model = zoo.build(TINY)
    optimizer = torch.optim.SGD(model.parameters(), lr=0.1, momentum=0.8)
    sum(p.square().sum() for p in model.parameters()).backward()
    optimizer.step()
    return checkpoint.State(model, optimizer, None)


def rewritten(path, change, **metadata) -> None:
    """Write a safetensors file anew with changed tensors and metadata."""
    from safetensors import safe_open

    with safe_open(path, framework='pt') as file:
        own = file.metadata() | metadata
    tensors = load_file(path)
    change(tensors)
    save_file(tensors, path, metadata={k: v for k, v in own.items() if v is not None})


@pytest.fixture
def weights(tmp_path):
    path = tmp_path / 'w.safetensors'
    zoo.save_weights(path, zoo.build(TINY), {})
    path.with_suffix('.json').unlink()  # the hash would speak first
    return path


def no_change(tensors) -> None:
    pass


def test_weights_of_another_format_name_both(weights):
    rewritten(weights, no_change, format='gcl-resunet-2')
    with pytest.raises(
        GclError, match="format 'gcl-resunet-2', this version reads 'gcl-resunet-1"
    ):
        zoo.load_weights(str(weights))


@pytest.mark.parametrize('network', [None, '', '{', '[1]', '{"voxel": 1}'])
def test_weights_that_do_not_tell_their_network_are_refused(weights, network):
    rewritten(weights, no_change, network=network)
    with pytest.raises(GclError, match=r'w\.safetensors'):
        zoo.load_weights(str(weights))


def test_weights_that_are_not_finite_are_refused(weights):
    rewritten(weights, lambda t: t['head.0.weight'].fill_(float('nan')))
    with pytest.raises(GclError, match=r'head\.0\.weight is not finite'):
        zoo.load_weights(str(weights))


def test_a_network_larger_than_its_weights_takes_no_memory(weights):
    """10^12 channels would: the file is held against the network before one is made."""
    network = {'encoder': [10**6] * 4, 'decoder': [10**6] * 3, 'head': 10**6, 'descriptor': 32}
    rewritten(weights, no_change, network=json.dumps(network))
    with pytest.raises(GclError, match='weights and network do not fit'):
        zoo.load_weights(str(weights))


@pytest.mark.parametrize(('written', 'named'), [('gcl-checkpoint-1',) * 2, (None, '')])
def test_checkpoints_of_another_format_name_both(tmp_path, written, named):
    path = tmp_path / 'c.safetensors'
    checkpoint.save(path, state(), 7, {})
    rewritten(path, no_change, format=written)
    with pytest.raises(GclError, match=f"{named}.* this version reads 'gcl-checkpoint-2"):
        checkpoint.load(path, state())


def test_moments_follow_their_parameters_not_their_order(tmp_path):
    """A network whose layers were since defined in another order goes on as it was."""
    path, written = tmp_path / 'c.safetensors', state()
    checkpoint.save(path, written, 7, {})
    read = state()
    read.optimizer.param_groups[0]['params'].reverse()
    read.optimizer.state.clear()
    assert checkpoint.load(path, read).step == 7
    for (name, own), theirs in zip(
        read.model.named_parameters(), written.model.parameters(), strict=True
    ):
        found = read.optimizer.state[own]['momentum_buffer']
        assert torch.equal(found, written.optimizer.state[theirs]['momentum_buffer']), name


def reshape(tensors) -> None:
    name = next(name for name in tensors if name.startswith('optimizer.'))
    tensors[name] = torch.zeros(3, 3, 3)


def rename(tensors) -> None:
    name = next(name for name in tensors if name.startswith('optimizer.'))
    tensors['optimizer.other.momentum_buffer'] = tensors.pop(name)


@pytest.mark.parametrize(
    ('change', 'metadata'),
    [
        (reshape, {}),
        (rename, {}),
        (lambda t: t.update(other=torch.zeros(1)), {}),
        (no_change, {'step': 'seven'}),
        (no_change, {'step': None}),
    ],
)
def test_checkpoints_that_do_not_fit_are_refused(tmp_path, change, metadata):
    path = tmp_path / 'c.safetensors'
    checkpoint.save(path, state(), 7, {})
    rewritten(path, change, **metadata)
    with pytest.raises(GclError, match='damaged or holds another network'):
        checkpoint.load(path, state())


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        (
            lambda c: c['estimated']['fit']['weight'].pop(),
            'json: estimated.fit weighs 9 columns of evidence, this version',
        ),
        (lambda c: c['trust']['only']['weight'].append(1.0), 'only weighs 3 columns'),
        (
            lambda c: c['refined']['choice'].update(bias=float('nan')),
            'a number of refined.choice is not finite',
        ),
        (lambda c: c['spread'].update(floor=float('inf')), 'spread is not finite'),
        (lambda c: c.pop('trust'), "key 'trust' is missing"),
        (
            lambda c: c.update(whole=dict(c), thin=dict(c)),
            r"keys 'whole' and 'thin' of an older version; .* gcl_core\.evaluation\.calibrate",
        ),
    ],
)
def test_calibrations_that_do_not_fit_are_refused(tmp_path, change, text):
    content = json.loads((zoo.FOLDER / zoo.SHIPPED).read_text())
    change(content)
    path = tmp_path / 'c.calibration.json'
    path.write_text(json.dumps(content))
    with pytest.raises(GclError, match=text):
        load_calibration(path)


WRITERS = {
    'w.safetensors': lambda path: zoo.save_weights(path, zoo.build(TINY), {}),
    'c.safetensors': lambda path: checkpoint.save(path, state(), 1, {}),
    't.json': lambda path: write_text(path, 'x' * 100_000),
    'c.bin': lambda path: write_big_cloud(path),
    'c.npy': lambda path: write_big_cloud(path),
    'c.pcd': lambda path: write_big_cloud(path),
    'c.ply': lambda path: write_big_cloud(path),
}


def write_big_cloud(path) -> None:
    from gcl_core.data.clouds import write_cloud

    write_cloud(path, PointCloud(torch.rand(20_000, 3).numpy()))


@pytest.mark.parametrize('name', WRITERS)
def test_on_a_full_disk_nothing_half_written_is_left(tmp_path, name):
    """A limit of 2 kB on files stands for the disk: writing fails in the same way."""
    path = tmp_path / name
    path.write_bytes(b'before')
    child = os.fork()
    if child == 0:
        code = 1
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (2048, resource.RLIM_INFINITY))
            WRITERS[name](path)
        except GclError as error:
            code = 0 if 'cannot write' in str(error) else 2
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert path.read_bytes() == b'before'
    assert [file.name for file in tmp_path.iterdir()] == [name]


def killed(path) -> None:
    with whole_file(path) as part:
        part.write_text('sec')
        raise KeyboardInterrupt


def test_a_kill_leaves_the_last_file_whole(tmp_path):
    path = tmp_path / 'f'
    write_text(path, 'first')
    with pytest.raises(KeyboardInterrupt):
        killed(path)
    assert path.read_text() == 'first'
    assert list(tmp_path.iterdir()) == [path]
