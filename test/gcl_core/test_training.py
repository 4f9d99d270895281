"""The trainer on a tiny network: it learns, logs, and resumes to the same weights."""

import json
from dataclasses import replace

import torch

from gcl_core.losses.combined import LossConfig
from gcl_core.models.resunet import ResUNetConfig
from gcl_core.training.recipe import GroupConfig, OptimizerConfig, TrainConfig
from gcl_core.training.samples import SampleConfig, SampleStream
from gcl_core.training.simulated import SimulationConfig
from gcl_core.training.trainer import Trainer

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


def test_resumed_run_ends_at_the_same_weights(tmp_path):
    whole = Trainer(CONFIG, tmp_path / 'whole')
    whole.run()
    rows = [json.loads(line) for line in (tmp_path / 'whole/log.jsonl').open()]
    assert [row['step'] for row in rows] == [1, 2, 3, 4]
    assert {'contrast', 'variance', 'finest', 'negative'} <= set(rows[-1])

    broken = Trainer(CONFIG, tmp_path / 'broken')
    stream = SampleStream(CONFIG.samples, CONFIG.network, CONFIG.seed, range(2), CONFIG.steps)
    for sample in stream:
        broken.train_step([sample])
    broken.save()
    resumed = Trainer(CONFIG, tmp_path / 'broken')
    assert resumed.step == 2
    resumed.run()
    for (name, a), b in zip(
        whole.shipped.state_dict().items(), resumed.shipped.state_dict().values(), strict=True
    ):
        torch.testing.assert_close(a, b, msg=name)


def test_loss_falls_on_one_sample(tmp_path):
    optimizer = OptimizerConfig(learning_rate=5e-3, warmup=3)
    config = replace(CONFIG, steps=30, optimizer=optimizer, loss=LossConfig())
    trainer = Trainer(config, tmp_path)
    sample = next(iter(SampleStream(config.samples, config.network, 1, range(1), 1)))
    losses = [trainer.train_step([sample])['contrast'] for _ in range(15)]
    assert losses[-1] < losses[0] - 0.5
