"""Commands that take long refuse at once to write where nothing can be written."""

import stat
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from safetensors.numpy import save_file

from gcl_core.bench import backbones, engine, registration, results
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError, bad_input_exits
from gcl_core.evaluation import calibrate, false_accepts
from gcl_core.evaluation.figures import __main__ as figures
from gcl_core.files import check_writable, whole_file
from gcl_core.registrar import Registrar

LONG = {
    'backbones': (backbones, []),
    'engine': (engine, []),
    'registration': (registration, []),
    'results': (results, []),
    'false_accepts': (false_accepts, ['--chunks', 'chunks']),
    'calibrate': (calibrate, ['--trials', 'trials']),
    'figures': (figures, ['drift', '--simulated', '3']),
}


def work(*_, **__):
    raise AssertionError('began to work')


@pytest.mark.parametrize(('module', 'arguments'), LONG.values(), ids=LONG)
def test_long_commands_look_first(module, arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Registrar, '__init__', work)
    monkeypatch.setattr(SimulatedSequence, '__init__', work)
    (tmp_path / 'file').write_text('')
    monkeypatch.setattr(sys, 'argv', ['x', *arguments, '--out', 'file/x.json'])
    with pytest.raises(SystemExit, match='2'):
        module.main()
    assert 'cannot write file/x.json: Not a directory' in capsys.readouterr().err


def test_looking_makes_the_folder_and_leaves_nothing_in_it(tmp_path):
    check_writable(tmp_path / 'a/b.json')
    assert [path.name for path in tmp_path.rglob('*')] == ['a']
    with pytest.raises(GclError, match='a: it is a folder'):
        check_writable(tmp_path / 'a')


def test_several_may_look_at_once(tmp_path):
    together = threading.Barrier(4, timeout=10)

    def look(number: int) -> None:
        together.wait()
        check_writable(tmp_path / str(number // 4) / 'a/b.json')

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(look, range(200)))


def test_whoever_may_read_a_new_file_may_read_weights(tmp_path):
    (tmp_path / 'any').touch()
    with whole_file(tmp_path / 'w.safetensors') as part:
        save_file({'x': np.zeros(3)}, part)
    modes = {stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()}
    assert len(modes) == 1


def test_ctrl_c_ends_a_command_without_a_traceback():
    with pytest.raises(SystemExit, match='130'), bad_input_exits('results'):
        raise KeyboardInterrupt
