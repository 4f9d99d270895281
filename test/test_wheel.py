"""The source distribution builds a wheel that registers where there is no compiler."""

import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import emulation
import numpy as np
import pytest
import torch

from gcl_core.ops import kernel_map
from gcl_core.ops.native import build, instructions
from gcl_core.ops.native.kernel_map import search as compiled_search
from gcl_core.ops.voxelize import encode

ROOT = Path(__file__).parents[1]
COMPILER = shutil.which(os.environ.get('CXX', 'c++'))
LIBRARIES = 'gcl_core/ops/native/lib/'
LOAD = 'from gcl_core.ops.native.build import library; print(library())'
REGISTER = """
import gcl_core
result = gcl_core.register('source.npy', 'target.npy')
print(gcl_core.__file__, result.accepted, result.T_target_source[:3, 3].round(1).tolist())
"""
pytestmark = pytest.mark.skipif(
    COMPILER is None or not sys.platform.startswith('linux'), reason='no C++ compiler, or no Linux'
)


@pytest.fixture(scope='module')
def source(tmp_path_factory):
    """The source distribution, unpacked."""
    folder = tmp_path_factory.mktemp('source')
    ignored = shutil.ignore_patterns(
        '.venv*', '.git', 'build', 'dist', 'runs', '*.egg-info', '.*_cache'
    )
    shutil.copytree(ROOT, folder / 'checkout', ignore=ignored)
    command = [sys.executable, 'setup.py', '-q', 'sdist', '-d', folder]
    subprocess.run(command, cwd=folder / 'checkout', check=True, capture_output=True)
    (archive,) = folder.glob('gcl_ros-*.tar.gz')
    with tarfile.open(archive) as file:
        file.extractall(folder, filter='data')
    return folder / archive.name.removesuffix('.tar.gz')


def built(source, out, *options, **environment):
    """A wheel of the source distribution."""
    command = [sys.executable, 'setup.py', '-q', 'bdist_wheel', '-d', out, *options]
    subprocess.run(
        command, cwd=source, env=os.environ | environment, check=True, capture_output=True
    )
    (wheel,) = out.iterdir()
    return wheel


@pytest.fixture(scope='module')
def wheel(source, tmp_path_factory):
    """The wheel of this machine's platform, as pip makes it."""
    out = tmp_path_factory.mktemp('wheel')
    command = [sys.executable, '-m', 'pip', 'wheel', '-q', '--no-deps', '--no-build-isolation']
    subprocess.run([*command, '-w', out, source], check=True, capture_output=True)
    (made,) = out.iterdir()
    return made


@pytest.fixture(scope='module')
def installed(wheel, tmp_path_factory):
    """A folder that the wheel was installed into; what it needs comes from this environment."""
    target = tmp_path_factory.mktemp('installed')
    command = [sys.executable, '-m', 'pip', 'install', '-q', '--no-deps', '--no-index']
    subprocess.run([*command, '--target', target, wheel], check=True, capture_output=True)
    return target


def without_compiler(code, package, folder, **environment):
    """What a fresh process says that knows no compiler."""
    told = {k: v for k, v in os.environ.items() if k != 'GCL_NATIVE'}
    told |= {'PYTHONPATH': str(package), 'CXX': '/nonexistent', **environment}
    told['XDG_CACHE_HOME'] = str(folder / 'cache')
    done = subprocess.run(
        [sys.executable, '-c', 'import logging; logging.basicConfig(level=20)\n' + code],
        env=told,
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert not (folder / 'cache').exists()
    return done.stdout + done.stderr


def libraries(wheel):
    with zipfile.ZipFile(wheel) as file:
        return {n.removeprefix(LIBRARIES) for n in file.namelist() if n.startswith(LIBRARIES)}


def every_library(machine):
    return {build.shipped_name(one, machine) for one in instructions.of(machine)}


def test_a_wheel_is_for_one_platform_any_python_and_every_instruction_set(wheel):
    tag = sysconfig.get_platform().replace('-', '_')
    assert wheel.name.endswith(f'-py3-none-{tag}.whl')
    assert libraries(wheel) == every_library(platform.machine())


def test_it_holds_what_is_installed_and_no_tests(wheel, source):
    with zipfile.ZipFile(wheel) as file:
        names = file.namelist()
    modules = {str(p.relative_to(source)) for p in source.glob('gcl_*/**/*.py')}
    assert modules == {n for n in names if n.startswith('gcl_') and n.endswith('.py')} - {
        n for n in names if '.data/' in n
    }
    for end in ('share/gcl_ros/config/registrar.yaml', 'share/gcl_ros/launch/replay.launch.py'):
        assert any(name.endswith(end) for name in names)
    assert not any(name.startswith('test') for name in names)


def test_the_source_distribution_can_be_tested(source):
    for name in ('Makefile', 'constraints.txt', 'test/emulation/driver.cpp', 'docs/install.md'):
        assert (source / name).is_file()


def test_it_registers_without_a_compiler(installed, drive, tmp_path):
    np.save(tmp_path / 'source.npy', drive.scan(14).points)
    np.save(tmp_path / 'target.npy', drive.scan(10).points)
    said = without_compiler(REGISTER, installed, tmp_path)
    assert f'compiled kernels ({instructions.available()[0].name}) of the package' in said
    assert f'{installed}/gcl_core/__init__.py True' in said


@pytest.mark.parametrize('name', [one.name for one in instructions.available()])
def test_each_instruction_set_loads(name, installed, tmp_path):
    said = without_compiler(LOAD, installed, tmp_path, GCL_NATIVE=name)
    assert f'compiled kernels ({name}) of the package' in said


def test_kernels_of_other_sources_are_not_taken(installed, tmp_path):
    changed = tmp_path / 'changed'
    shutil.copytree(installed / 'gcl_core', changed / 'gcl_core')
    with (changed / 'gcl_core/ops/native/octree.cpp').open('a') as file:
        file.write('// changed\n')
    assert 'plain torch' in without_compiler(LOAD, changed, tmp_path)


def test_kernels_that_do_not_load_leave_torch_and_a_warning(installed, tmp_path):
    damaged = tmp_path / 'damaged'
    shutil.copytree(installed / 'gcl_core', damaged / 'gcl_core')
    for path in (damaged / LIBRARIES).iterdir():
        path.write_bytes(b'of another system')
    said = without_compiler(LOAD, damaged, tmp_path)
    assert 'WARNING' in said
    assert 'plain torch' in said


def test_without_a_compiler_it_is_for_any_platform(source, tmp_path):
    wheel = built(source, tmp_path, CXX='/nonexistent')
    assert wheel.name.endswith('-py3-none-any.whl')
    assert not libraries(wheel)


def test_a_compiler_for_another_processor_is_refused(source, tmp_path):
    compiler = tmp_path / 'c++'
    compiler.write_text('#!/bin/sh\necho sparc64-linux-gnu\n')
    compiler.chmod(0o755)
    with pytest.raises(subprocess.CalledProcessError) as refused:
        built(source, tmp_path / 'out', CXX=str(compiler))
    assert b'compiles for sparc64-linux-gnu' in refused.value.stderr


@pytest.mark.skipif(
    not shutil.which(emulation.COMPILER) or not shutil.which(emulation.EMULATOR),
    reason='no cross compiler or no emulator: make test-aarch64',
)
def test_a_wheel_for_aarch64_runs_emulated(source, tmp_path, monkeypatch):
    out = tmp_path / 'out'
    wheel = built(source, out, '--plat-name', 'linux_aarch64', CXX=emulation.COMPILER)
    assert wheel.name.endswith('-py3-none-linux_aarch64.whl')
    assert libraries(wheel) == every_library('aarch64')
    (neon, _) = instructions.of('aarch64')
    with zipfile.ZipFile(wheel) as file:
        library = file.extract(LIBRARIES + build.shipped_name(neon, 'aarch64'), tmp_path)
    emulated = emulation.EmulatedLibrary(Path(library), tmp_path / 'driver')
    monkeypatch.setattr(build, '_loaded', lambda _: emulated)
    generator = torch.Generator().manual_seed(1)
    keys = encode(torch.randint(-9, 9, (800, 3), generator=generator)).unique()
    rows, _ = compiled_search(keys, keys, (3, 3), axis_bits=16, with_inverse=True)
    assert torch.equal(rows, kernel_map.search(keys, keys, kernel_map.CUBE_3))
