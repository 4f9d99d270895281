"""The trainer on a tiny network: it learns, logs, and resumes to the same weights."""

import json
from dataclasses import replace

import torch

from gcl_core.models.resunet import ResUNetConfig
from gcl_core.training.samples import SampleConfig, SampleStream
from gcl_core.training.trainer import LossConfig, TrainConfig, Trainer

CONFIG = TrainConfig(
    network=ResUNetConfig(
        voxel_size=0.6, max_range=25.0, encoder=(4, 8, 8, 8), decoder=(8, 8), head=8
    ),
    samples=SampleConfig(phi=2, samples_per_world=100, sensor='hdl32e', yaw_deg=(10.0, 10.0)),
    loss=LossConfig(groups=128, gcl_from=0.25),
    steps=4,
    warmup=1,
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
    stream = SampleStream(CONFIG.samples, CONFIG.network, CONFIG.seed, 0, CONFIG.steps)
    for _, sample in zip(range(2), stream, strict=False):
        broken.train_step(sample)
    broken.save()
    resumed = Trainer(CONFIG, tmp_path / 'broken')
    assert resumed.step == 2
    resumed.run()
    for (name, a), b in zip(
        whole.model.state_dict().items(), resumed.model.state_dict().values(), strict=True
    ):
        torch.testing.assert_close(a, b, msg=name)


def test_loss_falls_on_one_sample(tmp_path):
    config = replace(CONFIG, steps=30, learning_rate=5e-3, warmup=3, loss=LossConfig(groups=128))
    trainer = Trainer(config, tmp_path)
    sample = next(iter(SampleStream(config.samples, config.network, 1, 0, 1)))
    losses = [trainer.train_step(sample)['contrast'] for _ in range(15)]
    assert losses[-1] < losses[0] - 0.5
