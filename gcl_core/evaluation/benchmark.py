"""What a benchmark is, as one strict YAML: scans, pairs, methods, criteria, figures."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from gcl_core.compact.scan import CompactConfig
from gcl_core.data.pairs import BINS
from gcl_core.data.simulator.meeting import Manoeuvre
from gcl_core.errors import GclError
from gcl_core.evaluation.metrics import Criterion
from gcl_core.evaluation.published import published
from gcl_core.registrar import RegistrarConfig


@dataclass(frozen=True)
class SourceConfig:
    """Where scans come from.

    Attributes:
        data: a data set, bag or folder of clouds; empty: `--data` of the command line.
        layout: of the data; seen from the folder if empty.
        columns: of `.bin` files, such as `5` or `4xfloat64`; seen from the numbers if empty.
        sequences: names, or `*` for all there are; empty: the only one, or those of pair lists.
        simulated: seeds of worlds, instead of data.
        meet: how a second simulated vehicle meets the first; pairs are drawn among the scans of
            both. None: one vehicle.
        sensors: of the simulated vehicles (HDL-64E if empty); of recorded scans one name, for the
            table by sensor pair.
        deskew: seconds of a sweep, such as 0.1: recorded scans are straightened by the drive's own
            speed, see `gcl_core.data.deskewed`; 0 takes them as they are.
        compact: voxel size, metres: scans are sent as compact scans (`gcl_core.compact`) and
            received; 0 takes them as they are.
        each: report each sequence by itself, not all in one.
    """

    data: str = ''
    layout: str = ''
    columns: str = ''
    sequences: tuple[str, ...] = ()
    simulated: tuple[int, ...] = ()
    meet: Manoeuvre | None = None
    sensors: tuple[str, ...] = ()
    deskew: float = 0.0
    compact: float = 0.0
    each: bool = False

    def __post_init__(self) -> None:
        if self.simulated and self.deskew:
            raise GclError(
                'source.deskew or --deskew is of --data; simulated scans need none: leave it out'
            )
        if self.compact:
            CompactConfig(voxel_size=self.compact)  # refuses what cannot be sent
        most = 2 if self.meet else 1
        if len(self.sensors) > most:
            raise GclError(
                f'{len(self.sensors)} sensors given ({", ".join(self.sensors)}) for {most} '
                'vehicle(s); two of them need source.meet'
            )


@dataclass(frozen=True)
class PairsConfig:
    """One set of pairs; see `gcl_core.data.pair_sets`.

    Attributes:
        kind: `random` in bins of distance; `distance`, the paper's [b1, b2]; `fcgf`, KITTI
            [10,10]; `low_overlap`, LoKITTI and LoNuScenes; `list`, a file.
        per_bin: of `random`.
        seed: of `random`.
        between: of `random`: only pairs between the two simulated vehicles of `source.meet`.
        ranges: of `distance`, metres.
        file: of `list`.
        limit: most pairs of a set (of each range), spread evenly over it; 0 for all.
        name: of the set in results; by its kind if empty.
    """

    kind: Literal['random', 'distance', 'fcgf', 'low_overlap', 'list'] = 'random'
    per_bin: int = 16
    seed: int = 0
    between: bool = False
    ranges: tuple[tuple[int, int], ...] = BINS
    file: str = ''
    limit: int = 0
    name: str = ''

    def __post_init__(self) -> None:
        if self.per_bin < 1:
            raise GclError(f'pairs.per_bin is {self.per_bin}; it must be at least 1')
        if self.limit < 0:
            raise GclError(f'pairs.limit is {self.limit}; it must be at least 0')


@dataclass(frozen=True)
class Ours:
    """This project's registrar.

    Attributes:
        name: in results.
        registrar: its settings, weights among them.
        give: `accepted` withholds what the registrar does not accept; `best` gives the best
            hypothesis whatever its probability, as the paper does; both, from one run, are two
            rows in results.
        trained_by: recipe of the weights and its settings, `config/x.yaml --set KEY=VALUE`, for
            the message when they are missing.
        voxel_size: of the network, instead of the one that it was trained with, metres.
    """

    kind: Literal['ours'] = 'ours'
    name: str = 'GCL-ROS'
    registrar: RegistrarConfig = field(default_factory=RegistrarConfig)
    give: tuple[Literal['accepted', 'best'], ...] = ('accepted',)
    trained_by: str = ''
    voxel_size: float | None = None

    @property
    def estimators(self) -> dict[str, str]:
        """Estimator of each name in results."""
        return dict.fromkeys(self.labels.values(), self.registrar.estimator.name)

    @property
    def labels(self) -> dict[str, str]:
        """Name in results of each kind of answer given."""
        best = f'{self.name}, nothing withheld' if len(self.give) > 1 else self.name
        return {kind: best if kind == 'best' else self.name for kind in self.give}


@dataclass(frozen=True)
class Peer:
    """Another method; see `gcl_core.evaluation.peers`.

    Attributes:
        name: FPFH and Open3D's RANSAC; FPFH and fast global registration; KISS-Matcher; GICP
            from the identity.
    """

    kind: Literal['peer'] = 'peer'
    name: Literal['fpfh', 'fpfh_fgr', 'kiss_matcher', 'gicp'] = 'fpfh'

    @property
    def estimators(self) -> dict[str, str]:
        """Estimator of each name in results."""
        return {self.name: {'fpfh': 'open3d_ransac', 'fpfh_fgr': 'fgr'}.get(self.name, self.name)}


@dataclass(frozen=True)
class Estimators:
    """Every estimator on every kind of features; see `gcl_core.evaluation.compare`.

    Attributes:
        names: of estimators; `paper` is Open3D's RANSAC on the paper's matches.
        features: `ours` or `fpfh`.
        registrar: settings of matching, of each estimator and of the refinement.
    """

    kind: Literal['estimators'] = 'estimators'
    names: tuple[
        Literal['ransac', 'spatial_consistency', 'open3d_ransac', 'kiss_matcher', 'paper'], ...
    ] = ('ransac',)
    features: tuple[Literal['ours', 'fpfh'], ...] = ('ours', 'fpfh')
    registrar: RegistrarConfig = field(default_factory=RegistrarConfig)

    @property
    def estimators(self) -> dict[str, str]:
        """Estimator of each name in results."""
        return {f'{kind} + {name}': name for kind in self.features for name in self.names}


MethodConfig = Ours | Peer | Estimators  # told apart by `kind`


@dataclass(frozen=True)
class BenchmarkConfig:
    """A benchmark.

    Attributes:
        title: of the report.
        source: of scans.
        pairs: sets of pairs; may be empty where only figures are drawn.
        random_yaw: turn each source by a random heading.
        seed: of the headings and of figures.
        methods: on the same pairs, in this order.
        overlap: measure the overlap of every pair, for the table by overlap.
        criteria: more of them than strict and loose.
        published: tables of the paper to show beside; see `published.yaml`.
        figures: analysis figures to draw; see `gcl_core.evaluation.figures`.
        worst: cases shown in 3-D.
    """

    title: str = 'Recall by distance'
    source: SourceConfig = field(default_factory=SourceConfig)
    pairs: tuple[PairsConfig, ...] = (PairsConfig(),)
    random_yaw: bool = False
    seed: int = 0
    methods: tuple[MethodConfig, ...] = (Ours(),)
    overlap: bool = True
    criteria: tuple[Criterion, ...] = ()
    published: tuple[str, ...] = ()
    figures: tuple[Literal['correlation', 'positives', 'drift', 'inliers', 'eth_recall'], ...] = ()
    worst: int = 6

    def __post_init__(self) -> None:
        names = [name for method in self.methods for name in method.estimators]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise GclError(f'methods: {", ".join(twice)} come twice; give each its own name')
        if not self.methods:
            raise GclError('methods is empty; name at least one')
        for name in self.published:
            published(name)
        of_features = {*self.figures} - {'correlation', 'positives'}
        if of_features and not any(isinstance(method, Ours) for method in self.methods):
            raise GclError(f'figures: {", ".join(of_features)} need a method of kind ours')

    @property
    def estimators(self) -> dict[str, str]:
        """Estimator of every method by its name in results, in order."""
        return {k: v for method in self.methods for k, v in method.estimators.items()}
