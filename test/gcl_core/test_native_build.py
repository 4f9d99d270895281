"""How the kernels come about: instruction sets, where they are kept, what is trusted."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from gcl_core.errors import GclError
from gcl_core.ops.native import build, instructions
from gcl_core.ops.precision import best_dtype

ROOT = Path(__file__).parents[2]
COMPILER = shutil.which(os.environ.get('CXX', 'c++'))
needs_compiler = pytest.mark.skipif(COMPILER is None, reason='no C++ compiler')
LOAD = 'from gcl_core.ops.native.build import library; print(library() is None, library() is None)'


def in_fresh_process(code: str, *, without: tuple[str, ...] = (), **environment: str) -> str:
    told = {k: v for k, v in os.environ.items() if k not in (*without, 'GCL_NATIVE')}
    done = subprocess.run(
        [sys.executable, '-c', 'import logging; logging.basicConfig(level=20)\n' + code],
        env=told | environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_switched_off_it_says_so_once():
    said = in_fresh_process(LOAD, GCL_NATIVE='0')
    assert 'True True' in said
    assert said.count('plain torch') == 1


def test_a_compiler_that_fails_leaves_torch_and_a_warning(tmp_path):
    said = in_fresh_process(LOAD, CXX='false', XDG_CACHE_HOME=str(tmp_path))
    assert 'True True' in said
    assert 'WARNING' in said


@needs_compiler
@pytest.mark.parametrize('name', [one.name for one in instructions.available()])
def test_the_log_names_the_instruction_set_that_is_used(name, tmp_path):
    said = in_fresh_process(LOAD, XDG_CACHE_HOME=str(tmp_path), GCL_NATIVE=name)
    assert 'False False' in said
    assert f'compiled kernels ({name})' in said


@needs_compiler
@pytest.mark.skipif(os.uname().machine != 'x86_64', reason='options of an x86-64 compiler')
@pytest.mark.parametrize('one', [s for s in instructions.SETS if s.machine != 'aarch64'])
def test_kernels_compile_for_processors_that_this_one_is_not(one, tmp_path):
    out = tmp_path / 'kernels.so'
    subprocess.run(build.command(COMPILER, one.options, out), check=True)
    assert out.is_file()


EVERYTHING = frozenset().union(*(one.needs for one in instructions.SETS))


@pytest.fixture
def processor(monkeypatch):
    """Function that makes this machine one of other abilities."""

    def become(flags, machine='x86_64'):
        monkeypatch.setattr(instructions.platform, 'machine', lambda: machine)
        found = frozenset(flags)
        monkeypatch.setattr(instructions, 'flags', lambda: found)
        instructions.available.cache_clear()

    yield become
    monkeypatch.undo()
    instructions.available.cache_clear()


@pytest.mark.parametrize(
    ('lacking', 'machine', 'best', 'dtype'),
    [
        ((), 'x86_64', 'avx512_bf16', torch.bfloat16),
        (('avx512_bf16',), 'x86_64', 'avx512', torch.float32),
        (('avx512dq', 'avx512_bf16'), 'x86_64', 'avx2', torch.float32),
        (EVERYTHING, 'x86_64', 'baseline', torch.float32),
        (EVERYTHING, 'aarch64', 'neon', torch.float32),
    ],
)
def test_the_best_set_of_a_processor_and_what_it_multiplies_fastest(
    lacking, machine, best, dtype, processor, monkeypatch
):
    processor(EVERYTHING - set(lacking), machine)
    monkeypatch.delenv('GCL_NATIVE', raising=False)
    assert instructions.held().name == best
    assert best_dtype() == dtype
    monkeypatch.setenv('GCL_NATIVE', '0')  # torch uses what the processor has
    assert instructions.held() is None
    assert best_dtype() == dtype


def test_precision_follows_the_set_that_kernels_are_held_to(processor, monkeypatch):
    processor(EVERYTHING)
    monkeypatch.setenv('GCL_NATIVE', 'avx512')
    assert best_dtype() == torch.float32
    monkeypatch.setenv('GCL_NATIVE', 'avx512_bf16')
    assert best_dtype() == torch.bfloat16


@pytest.mark.parametrize(
    ('wanted', 'why'),
    [
        ('avx512', 'lacks avx512bw, avx512cd, avx512dq, avx512f, avx512vl'),
        ('neon', 'lacks a processor of aarch64'),
        ('AVX2', 'names no instruction set'),
        ('amx', 'names no instruction set'),
    ],
)
def test_what_the_machine_lacks_is_named_with_what_it_has(wanted, why, processor, monkeypatch):
    processor(one for one in EVERYTHING if 'avx512' not in one)
    monkeypatch.setenv('GCL_NATIVE', wanted)
    with pytest.raises(GclError, match=f'GCL_NATIVE is .{wanted}.: .*{why}.*0, avx2, baseline'):
        build.library()


def nowhere(tmp_path: Path) -> str:
    """A cache folder that root cannot write to either."""
    (tmp_path / 'file').touch()
    return str(tmp_path / 'file')


@needs_compiler
def test_compiled_once_into_a_private_folder(tmp_path):
    said = in_fresh_process(LOAD, XDG_CACHE_HOME=str(tmp_path))
    assert 'False False' in said
    (folder,) = tmp_path.iterdir()
    assert folder.stat().st_mode & 0o077 == 0
    (kernels,) = folder.iterdir()
    before = kernels.stat().st_mtime_ns
    in_fresh_process(LOAD, XDG_CACHE_HOME=str(tmp_path))
    assert [path.stat().st_mtime_ns for path in folder.iterdir()] == [before]


@needs_compiler
@pytest.mark.parametrize('lost', ['no home', 'relative home', 'cache not writable'])
def test_without_a_cache_kernels_are_compiled_once_all_the_same(lost, tmp_path):
    temporary = tmp_path / 'tmp'
    temporary.mkdir()
    environment = {'TMPDIR': str(temporary)}
    code, without = LOAD, ('XDG_CACHE_HOME',)
    if lost == 'no home':
        # What a container's user without HOME and without an entry in passwd gets.
        code = 'import pwd; pwd.getpwuid = {}.__getitem__\n' + LOAD
        without = ('XDG_CACHE_HOME', 'HOME')
    elif lost == 'relative home':
        environment['HOME'] = 'somewhere'
    else:
        environment['XDG_CACHE_HOME'] = nowhere(tmp_path)
    for _ in range(2):
        assert 'False False' in in_fresh_process(code, without=without, **environment)
    (folder,) = temporary.iterdir()
    assert folder.stat().st_mode & 0o077 == 0
    assert len(list(folder.iterdir())) == 1


@needs_compiler
def test_a_cache_that_can_only_be_read_is_read(tmp_path, monkeypatch):
    in_fresh_process(LOAD, XDG_CACHE_HOME=str(tmp_path))
    monkeypatch.setattr(build, '_prepared', lambda folder: pytest.fail(f'{folder} is written to'))
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    monkeypatch.delenv('GCL_NATIVE', raising=False)
    assert build._load(COMPILER, instructions.held()) is not None


@needs_compiler
@pytest.mark.parametrize('theirs', ['folder', 'link', 'file'])
def test_what_others_may_have_written_is_not_loaded(theirs, tmp_path, monkeypatch):
    """A stranger waits at the fixed name among temporary files; nothing is left behind there."""
    stranger, temporary = tmp_path / 'stranger', tmp_path / 'tmp'
    temporary.mkdir()
    monkeypatch.setenv('XDG_CACHE_HOME', nowhere(tmp_path))
    monkeypatch.setattr(build.tempfile, 'tempdir', str(temporary))
    monkeypatch.delenv('GCL_NATIVE', raising=False)
    held = instructions.held()
    digest = build._digest(held, build._version(COMPILER))
    name = f'kernels-{held.name}-{digest}.so'
    folder = temporary / f'gcl_ros-{os.getuid()}'
    target = stranger if theirs == 'link' else folder
    target.mkdir(mode=0o700)
    (target / name).write_text('not a library: to load it is an error')
    if theirs == 'link':
        folder.symlink_to(stranger)
    (target / name if theirs == 'file' else target).chmod(0o777)
    assert build._load(COMPILER, held) is not None
    assert list(temporary.iterdir()) == [folder]
    if theirs != 'file':
        assert (target / name).read_text().startswith('not a library')


@needs_compiler
@pytest.mark.skipif(os.getuid() != 0, reason='only root can give a file to another user')
def test_a_folder_of_another_user_is_left_alone(tmp_path):
    os.chown(tmp_path, 12345, 12345)
    assert not build._own(tmp_path)
    assert not build._prepared(tmp_path)
    (tmp_path / 'link').symlink_to('/usr')
    os.chown(tmp_path / 'link', 12345, 12345, follow_symlinks=False)
    assert not build._own(tmp_path / 'link')
