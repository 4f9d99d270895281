"""The sparse-convolution engine against the naive way and spconv: `make bench-engine`.

Network: FCGF's ResUNetBN2C (8.75 M weights), one simulated HDL-64E scan at 0.3 m. Naive is
gather, product, scatter for each offset in plain torch, float32 (GCL_NATIVE=0).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import torch

from gcl_core.bench.measure import gemm_gflops, milliseconds, peak_mb
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import bad_input_exits
from gcl_core.models.blocks import ConvNorm
from gcl_core.models.resunet import ResUNet, ResUNetConfig
from gcl_core.models.zoo import load_weights
from gcl_core.ops.kernel_map import KernelMap, build_pyramid
from gcl_core.ops.memory import keep_freed_memory
from gcl_core.ops.precision import best_dtype
from gcl_core.ops.sparse_conv import sparse_conv
from gcl_core.provenance import provenance_for
from gcl_core.types import PointCloud, SparseTensor

FCGF = ResUNetConfig(encoder=(32, 64, 128, 256), decoder=(128, 64, 64), head=64)
SEED = 900  # of the street; training takes other worlds
NAMES = {torch.float32: 'fp32', torch.bfloat16: 'bf16'}


def main() -> None:
    """Measure everything, print a table, write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--out', type=Path, default=Path('bench/engine.json'))
    parser.add_argument('--naive', action='store_true', help=argparse.SUPPRESS)
    options = parser.parse_args()
    with bad_input_exits('engine'):
        here = {} if options.naive else provenance_for(options.out)
    keep_freed_memory()  # as the nodes and the trainer do
    scan, model, voxels = fixture()
    if options.naive:
        print(json.dumps(network(model, voxels, torch.float32, repeats=3)))
        return
    dtype = best_dtype()
    figures: dict[str, Any] = {'voxels': len(voxels.keys), 'dtype': NAMES[dtype]}
    figures['peak_mb'] = inference_memory(model, voxels, dtype)
    figures['maps_ms'] = milliseconds(lambda: maps(voxels))
    figures |= network(model, voxels, dtype)
    if dtype != torch.float32:
        fp32 = network(model, voxels, torch.float32)
        figures |= {f'{key}_fp32': value for key, value in fp32.items()}
        figures['cosine_to_fp32_p05'] = cosine(scan)
    naive = in_plain_torch()
    figures |= {f'{key}_naive': value for key, value in naive.items()}
    figures['speedup_vs_naive'] = naive['inference_ms'] / figures['inference_ms']
    figures |= layers(voxels, dtype)
    figures |= against_spconv(voxels, figures['layer_64_ms'])
    figures['gflop'] = pair_gflop(model, voxels)
    figures['gemm_gflops'] = gemm_gflops(dtype)
    convolving = figures['inference_ms'] - figures['maps_ms']
    figures['gemm_share'] = 1e3 * figures['gflop'] / convolving / figures['gemm_gflops']
    figures |= here
    rounded = {k: round(v, 6) if isinstance(v, float) else v for k, v in figures.items()}
    print('\n'.join(f'| {key} | {value} |' for key, value in rounded.items()))
    options.out.write_text(json.dumps(rounded, indent=2) + '\n')


def fixture() -> tuple[PointCloud, ResUNet, SparseTensor]:
    """A scan, the network with seeded weights, and the scan's voxels."""
    torch.manual_seed(0)
    model = ResUNet(FCGF).eval()
    street = SimulatedSequence(SEED)
    scan = street.scan(len(street) // 2)
    return scan, model, model.voxelize([scan])


def maps(voxels: SparseTensor) -> Any:
    """Every kernel map of the network."""
    levels = len(FCGF.encoder)
    return build_pyramid(voxels.keys, levels=levels, stem=ResUNet.STEM)


def network(
    model: ResUNet, voxels: SparseTensor, dtype: torch.dtype, repeats: int = 15
) -> dict[str, float]:
    """Inference, and forward plus backward, maps included, milliseconds."""
    model.dtype = dtype
    with torch.inference_mode():
        inference = milliseconds(lambda: model(voxels), repeats)
    model.train()

    def step() -> None:
        model.zero_grad(set_to_none=True)
        model(voxels)[1].sum().backward()

    train = milliseconds(step, repeats)
    model.eval()
    return {'inference_ms': inference, 'train_step_ms': train}


def inference_memory(model: ResUNet, voxels: SparseTensor, dtype: torch.dtype) -> float:
    """Growth of the process's peak during its first inference, MB."""
    model.dtype = dtype
    before = peak_mb()
    with torch.inference_mode():
        model(voxels)
    return peak_mb() - before


def cosine(scan: PointCloud) -> float:
    """Cosine of bfloat16 to float32 descriptors, shipped weights, that 95 % of voxels exceed."""
    model, descriptors = load_weights(), []
    voxels = model.voxelize([scan])
    for dtype in (torch.float32, torch.bfloat16):
        model.dtype = dtype
        with torch.inference_mode():
            descriptors.append(model(voxels)[1])
    return float((descriptors[0] * descriptors[1]).sum(1).quantile(0.05))


def in_plain_torch() -> dict[str, float]:
    """`network` of a process without the compiled kernels."""
    command = [sys.executable, '-m', 'gcl_core.bench.engine', '--naive']
    environment = {**os.environ, 'GCL_NATIVE': '0'}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def layers(voxels: SparseTensor, dtype: torch.dtype) -> dict[str, float]:
    """One convolution on the finest level, forward, at several widths."""
    kmap = maps(voxels).same[0]
    figures = {}
    for width in (32, 64, 128):
        x = torch.randn(len(voxels.keys), width).to(dtype)
        weight = torch.randn(27, width, width)
        with torch.inference_mode():
            took = milliseconds(lambda x=x, w=weight: sparse_conv(x, w, kmap))
        figures[f'layer_{width}_ms'] = took
        figures[f'layer_{width}_gflops'] = 2e-6 * pairs(kmap) * width**2 / took
    return figures


def against_spconv(voxels: SparseTensor, ours_ms: float) -> dict[str, float | None]:
    """Compare a 64 to 64 convolution, maps not counted, with spconv's CPU build if installed."""
    try:
        from spconv import pytorch as spconv  # type: ignore[import-not-found]
    except ImportError:
        return {'spconv_64_ms': None, 'speedup_vs_spconv_64': None}
    mask = (1 << 16) - 1
    axes = [(voxels.keys >> shift) & mask for shift in (32, 16, 0)]
    coords = torch.stack([torch.zeros_like(axes[0]), *(a - a.min() for a in axes)], 1).int()
    shape = (coords.amax(0)[1:] + 1).tolist()
    x = spconv.SparseConvTensor(torch.randn(len(coords), 64), coords, shape, 1)
    conv = spconv.SubMConv3d(64, 64, 3, bias=False, indice_key='map', algo=spconv.ConvAlgo.Native)
    with torch.no_grad():
        took = milliseconds(lambda: conv(x), 5)
    return {'spconv_64_ms': took, 'speedup_vs_spconv_64': took / ours_ms}


def pairs(kmap: KernelMap) -> int:
    """Pairs of voxels that a map connects."""
    return int((kmap.neighbors < kmap.num_inputs).sum())


def pair_gflop(model: ResUNet, voxels: SparseTensor) -> float:
    """Work of one inference on existing pairs, convolutions only, GFLOP."""
    total = 0

    def count(module: torch.nn.Module, inputs: tuple[Any, ...]) -> None:
        nonlocal total
        assert isinstance(module, ConvNorm)
        total += 2 * pairs(inputs[1]) * module.conv.weight[0].numel()

    blocks = [module for module in model.modules() if isinstance(module, ConvNorm)]
    hooks = [block.register_forward_pre_hook(count) for block in blocks]
    with torch.inference_mode():
        model(voxels)
    for hook in hooks:
        hook.remove()
    return total / 1e9


if __name__ == '__main__':
    main()
