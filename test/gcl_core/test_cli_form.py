"""What every command has in common: help, examples, exit codes, completion, a fast start."""

import argparse
import io
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from typing import get_args

import numpy as np
import pytest

from gcl_core.cli.main import main, parser
from gcl_core.cli.outcome import Answer, run_command, say
from gcl_core.cli.parsers import choices, quantities
from gcl_core.data.formats import LAYOUTS
from gcl_core.data.simulator.kinds import KINDS
from gcl_core.data.simulator.meeting import Manoeuvre
from gcl_core.data.simulator.sensors import SENSORS
from gcl_core.errors import GclError
from gcl_core.estimation.estimators import ESTIMATORS
from gcl_core.evaluation.compare import PAPER
from gcl_core.evaluation.peers import PEERS
from gcl_core.progress import progress
from gcl_core.to_json import to_json
from gcl_ros import describer, evaluate_bag, registrar, replay, sender
from gcl_ros.program import own_arguments

PROGRAMS = (registrar, sender, describer, replay, evaluate_bag)


def parsers(root):
    """A parser and those of its subcommands."""
    yield root
    for action in root._actions:
        if isinstance(action, argparse._SubParsersAction):
            for inner in action.choices.values():
                yield from parsers(inner)


MADE = (parser, *(program.parser for program in PROGRAMS))
ALL = {p.prog: p for made in MADE for p in parsers(made())}


@pytest.mark.parametrize('name', ALL)
def test_help_says_what_for_how_and_how_it_ends(name):
    text = ALL[name].format_help()
    assert ALL[name].description
    assert 'exit codes:\n  0 done, 1 no transform accepted, 2 bad input' in text
    examples = text[text.index('\nexample') :].splitlines()[2:]
    lines = [line.strip() for line in examples[: examples.index('')]]
    assert lines
    for line in lines:
        words = shlex.split(line.removeprefix('ros2 run gcl_ros '))
        if '--help' not in words:
            ALL[words[0]].parse_args(own_arguments(words[1:]))


@pytest.mark.parametrize(
    ('written', 'known'),
    [
        (choices.LAYOUTS, LAYOUTS),
        (choices.SENSORS, SENSORS),
        (choices.KINDS, KINDS),
        (choices.MANOEUVRES, get_args(Manoeuvre)),
        (choices.PEERS, PEERS),
        (choices.ESTIMATORS, [*ESTIMATORS, PAPER]),
    ],
)
def test_choices_are_those_there_are(written, known):
    assert sorted(written) == sorted(known)


LIGHT = ('gcl_core.cli.main', *(program.__name__ for program in PROGRAMS))


@pytest.mark.parametrize('module', LIGHT)
def test_help_loads_nothing_heavy(module):
    code = (
        f'import sys; from {module} import main; sys.argv[1:] = ["--help"]\n'
        'try: main()\n'
        'except SystemExit: pass\n'
        'print(sorted({"torch", "numpy", "open3d", "rclpy", "tqdm"} & set(sys.modules)))'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == '[]'


@pytest.mark.parametrize(
    'arguments',
    [
        ['evaluate', '--simulated', '3', '--per-bin', '0'],
        ['pairs', 'p', '--data', '.', '--random', '0'],
        ['simulate', '5', 'x', '--spacing', 'nan'],
        ['simulate', '-5', 'x'],
        ['inspect', '--simulated', '5', '--compare', '0'],
        ['bag', 'from-simulator', '5', 'x', '--distance', 'inf'],
    ],
)
def test_numbers_that_make_no_sense_are_refused(arguments, capsys):
    with pytest.raises(SystemExit, match='2'):
        main(arguments)
    assert ' is no ' in capsys.readouterr().err.splitlines()[-1]


def test_quantities():
    assert quantities.count('1') == 1
    assert quantities.seed('0') == 0
    assert quantities.positive('1e-3') == 1e-3
    assert quantities.not_negative('0') == 0
    for kind, text in (('count', '1.5'), ('seed', str(2**63)), ('not_negative', '-1')):
        with pytest.raises(argparse.ArgumentTypeError, match='is no'):
            getattr(quantities, kind)(text)


def fails(error):
    def work():
        raise error

    return work


@pytest.mark.parametrize(
    ('error', 'code', 'told'),
    [
        (GclError('no file x'), 2, 'gcl x: no file x\n'),
        (KeyboardInterrupt(), 130, ''),
        (PermissionError(13, 'Permission denied', '/x'), 2, 'gcl x: /x: Permission denied; check'),
        (ModuleNotFoundError("No module named 'torch'"), 2, 'install what is missing'),
        (
            GclError('Caught.\nOriginal Traceback (…):\n  File\ngcl.GclError: no x\n'),
            2,
            ': no x\n',
        ),
    ],
)
def test_errors_are_one_line_and_a_code(error, code, told, capsys):
    assert run_command('gcl x', fails(error)) == code
    err = capsys.readouterr().err
    assert told in err
    assert err.count('\n') == (1 if told else 0)


def test_the_answer_is_alone_on_stdout(capsys):
    def work():
        print('a library warns')
        return Answer('answer', 1)

    assert say(work) == 1
    assert capsys.readouterr() == ('answer\n', 'a library warns\n')


LONG = (
    'import sys; from gcl_core.cli.outcome import Answer, run_command, say\n'
    'sys.exit(run_command("gcl", lambda: say(lambda: Answer("line\\n" * 100_000))))'
)


def test_a_reader_that_goes_leaves_no_traceback():
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([sys.executable, '-c', LONG], stdout=write, stderr=subprocess.PIPE)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, b'')


def test_a_full_disk_is_told():
    with open('/dev/full', 'w') as full:
        done = subprocess.run([sys.executable, '-c', LONG], stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 2
    assert done.stderr.startswith(b'gcl: ')
    assert done.stderr.count(b'\n') == 1


def test_interrupting_a_command_leaves_no_traceback(tmp_path):
    command = [sys.executable, '-m', 'gcl_core.cli.main', 'simulate', '5', str(tmp_path / 'o')]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(
            signal.SIGINT, signal.SIG_DFL
        ),  # ignored in background jobs
    ) as process:
        while not (tmp_path / 'o').exists():
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, b'', b'')


def test_progress_is_for_terminals(monkeypatch):
    monkeypatch.setattr(sys, 'stderr', io.StringIO())
    assert progress(range(3)).disable
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    assert not progress(range(3), file=terminal).disable
    assert progress(range(3), file=terminal, hidden=True).disable
    assert terminal.getvalue() == ''  # not before 2 s


def test_json_has_no_number_that_is_none():
    value = {'a': np.array([1.0, np.nan]), 'b': (np.int64(2), True, None), 'c': float('inf')}
    assert json.loads(to_json(value)) == {'a': [1.0, None], 'b': [2, True, None], 'c': None}


def test_the_shell_completes_commands_and_names(tmp_path):
    pytest.importorskip('argcomplete', reason='argcomplete is not installed')
    found = tmp_path / 'found'
    for line, expected in (('gcl re', 'register'), ('gcl simulate 7 x --meet onc', 'oncoming')):
        asked = {'_ARGCOMPLETE': '1', 'COMP_LINE': line, 'COMP_POINT': str(len(line))}
        asked |= {'_ARGCOMPLETE_STDOUT_FILENAME': str(found), 'COMP_TYPE': '9'}
        command = [sys.executable, '-m', 'gcl_core.cli.main']
        subprocess.run(command, env={**os.environ, **asked}, check=True)
        assert found.read_text().split() == [expected]
