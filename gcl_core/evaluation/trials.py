"""What came of a registration, hypothesis by hypothesis, beside the truth."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from safetensors import safe_open
from safetensors.torch import save_file

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.estimation.decision import Finalist, examine, nothing_fits
from gcl_core.estimation.hypothesis import Hypothesis
from gcl_core.estimation.refine import Refined
from gcl_core.evaluation import metrics
from gcl_core.files import whole_file
from gcl_core.registrar import Registrar
from gcl_core.stopwatch import Stopwatch
from gcl_core.types import Features, Heading
from gcl_core.view import View

GATE_MARGIN = 1.0  # log odds below the gate that are refined all the same: to set a new one


@dataclass(frozen=True)
class Trial:
    """One pair of scans.

    Attributes:
        kind: where the pair comes from.
        distance: between the sensors, metres; inf for unrelated places.
        columns: evidence on each hypothesis as estimated.
        right: whether it lies within 2 m and 5 degrees of the truth.
        finalists: as refined; none where nothing was worth refining.
        errors: of each finalist: x, y, z, rot_x, rot_y, rot_z, about the target's axes, metres
            and radians; inf for unrelated places.
    """

    kind: str
    distance: float
    columns: Float[torch.Tensor, 'h 10']
    right: Bool[torch.Tensor, ' h']
    finalists: list[Finalist]
    errors: Float[torch.Tensor, 'f 6']

    @property
    def strict(self) -> Bool[torch.Tensor, ' f']:
        """Which finalists meet the strict criterion."""
        rte, rre = self.errors[:, :3].norm(dim=1), self.errors[:, 3:].norm(dim=1)
        return (rte <= metrics.STRICT.rte) & (rre.rad2deg() <= metrics.STRICT.rre_deg)


def blurred(view: View, sigma: float, generator: torch.Generator) -> View:
    """Add noise to descriptors, which real scans look like to a network trained on simulated ones.

    Args:
        view: scan.
        sigma: of the noise on each number of a unit descriptor.
        generator: of the noise.
    """
    headings = []
    for heading in view.headings:
        points, descriptors = heading.features.points, heading.features.descriptors
        noise = torch.randn(descriptors.shape, generator=generator)
        noisy = torch.nn.functional.normalize(descriptors.float() + sigma * noise, dim=1)
        headings.append(Heading(heading.yaw, Features(points, noisy)))
    return replace(view, headings=tuple(headings))


def run_trials(
    registrar: Registrar,
    *,
    source: View,
    target: View,
    T_true: Float[np.ndarray, '4 4'] | None,
    kind: str,
) -> Iterator[Trial]:
    """Register a pair as `Registrar.register_views` does, at every look, accepted or not.

    A look without a hypothesis is no trial.
    """
    if T_true is not None:
        T_true = target.T_view_lidar @ T_true @ se3.inverse(source.T_view_lidar)
    search = registrar.search(target, Stopwatch())
    for look in registrar.looks(source=source, target=target):
        hypotheses, _ = registrar.hypotheses(search, look)
        if hypotheses:
            yield _trial(registrar, hypotheses, look, target, T_true, kind)


def _trial(
    registrar: Registrar,
    hypotheses: list[Hypothesis],
    source: View,
    target: View,
    T_true: Float[np.ndarray, '4 4'] | None,
    kind: str,
) -> Trial:
    scene = registrar.scene(source=source, target=target)
    columns = examine(hypotheses, scene, registrar.config.verify)
    calibration = registrar.calibration
    finalists = []
    if not nothing_fits(columns, replace(calibration, gate=calibration.gate - GATE_MARGIN)):
        odds = calibration.estimated.choice.log_odds(columns)
        finalists = registrar.finalists(hypotheses, odds, scene, source=source, target=target)
    right = [
        T_true is not None and metrics.registered(h.T_target_source.numpy(), T_true, metrics.LOOSE)
        for h in hypotheses
    ]
    errors = [error(f.refined.T_target_source, T_true) for f in finalists]
    return Trial(
        kind=kind,
        distance=np.inf if T_true is None else float(np.linalg.norm(T_true[:3, 3])),
        columns=columns,
        right=torch.tensor(right),
        finalists=finalists,
        errors=torch.from_numpy(np.array(errors).reshape(-1, 6)),
    )


def error(
    T_estimated: Float[np.ndarray, '4 4'], T_true: Float[np.ndarray, '4 4'] | None
) -> Float[np.ndarray, '6']:
    """What leads from the truth to the estimate: translation and rotation vector, target axes."""
    from scipy.spatial.transform import Rotation

    if T_true is None:
        return np.full(6, np.inf)
    turn = Rotation.from_matrix(T_estimated[:3, :3] @ T_true[:3, :3].T).as_rotvec()
    return np.concatenate([T_estimated[:3, 3] - T_true[:3, 3], turn])


def save_trials(path: Path, trials: Iterable[Trial]) -> None:
    """Write trials to a safetensors file."""
    tensors, pairs = {}, []
    for i, trial in enumerate(trials):
        pairs.append((trial.kind, trial.distance))
        tensors[f'{i}/columns'], tensors[f'{i}/right'] = trial.columns.contiguous(), trial.right
        tensors[f'{i}/errors'] = trial.errors
        for k, f in enumerate(trial.finalists):
            tensors[f'{i}/{k}/columns'] = f.columns.clone()
            numbers = [f.inliers, f.row, float(f.refined.walked), f.refined.residual]
            tensors[f'{i}/{k}/rivals'] = f.rivals
            tensors[f'{i}/{k}/numbers'] = torch.tensor(numbers, dtype=torch.float64)
            tensors[f'{i}/{k}/T'] = torch.from_numpy(f.refined.T_target_source.copy())
            tensors[f'{i}/{k}/information'] = torch.from_numpy(f.refined.information.copy())
    with whole_file(path) as part:
        save_file(tensors, part, metadata={'pairs': json.dumps(pairs)})


def load_trials(path: Path) -> list[Trial]:
    """Read what `save_trials` wrote.

    Raises:
        GclError: another version wrote it.
    """
    with safe_open(path, framework='pt') as file:
        get, metadata = file.get_tensor, file.metadata() or {}
        if 'pairs' not in metadata:
            raise GclError(f'{path} is of another version; remove it to collect it anew')
        trials = []
        for i, (kind, distance) in enumerate(json.loads(metadata['pairs'])):
            errors, finalists = get(f'{i}/errors'), []
            for k in range(len(errors)):
                inliers, row, walked, residual = get(f'{i}/{k}/numbers').tolist()
                T, information = get(f'{i}/{k}/T').numpy(), get(f'{i}/{k}/information').numpy()
                refined = Refined(T, information, bool(walked), residual)
                columns, rivals = get(f'{i}/{k}/columns'), get(f'{i}/{k}/rivals')
                finalists.append(Finalist(refined, columns, int(inliers), int(row), rivals))
            trials.append(
                Trial(
                    kind=kind,
                    distance=distance,
                    columns=get(f'{i}/columns'),
                    right=get(f'{i}/right'),
                    finalists=finalists,
                    errors=errors,
                )
            )
    return trials
