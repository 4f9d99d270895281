"""`make soak`: an hour in which everything goes wrong; JSON, and exit code 1 if the node did."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np

from gcl_core.data.sequence import positions
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import bad_input_exits
from gcl_core.files import write_text
from gcl_core.provenance import provenance, provenance_for
from gcl_ros.bag import Encounter, pair_encounters, read_encounters, write_bag
from gcl_ros.soak.faults import schedule
from gcl_ros.soak.machine import Machine
from gcl_ros.soak.observer import Observer
from gcl_ros.soak.watch import FLAT, Watch, in_short, memory_change
from gcl_ros.startup import running_ros
from gcl_ros.transport import keep_local

DOMAIN = '101'  # of DDS, unless one is set: nobody else's nodes, nor the tests'
WORLD, KIND = 11, 'mixed'  # a street that training never sees
DISTANCES = (8, 11, 14, 17, 20, 23, 26, 30)  # metres


def scenes() -> list[Encounter]:
    """A vehicle stands in a simulated street; another, facing the same way, drives off."""
    drive = SimulatedSequence(WORLD, kind=KIND)
    where, at = positions(drive), len(drive) // 2
    apart = np.linalg.norm(where[at:] - where[at], axis=1)
    pairs = [(at + int(np.abs(apart - d).argmin()), at) for d in DISTANCES]
    return list(pair_encounters(drive, drive, pairs, 1.0))


def soak(folder: Path, seconds: float, seed: int, stop: threading.Event) -> dict[str, Any]:
    """Run and return the report; whatever ends the run, it tells what was seen until then.

    Args:
        folder: for scenes and logs.
        seconds: how long.
        seed: of the faults.
        stop: set where somebody wants an end.
    """
    here = provenance()  # as it begins: an hour is long
    bag = folder / 'scenes'
    if not bag.exists():
        write_bag(bag, scenes())
    keep_local()
    os.environ.setdefault('ROS_DOMAIN_ID', DOMAIN)
    watch, problem = Watch(), ''
    with running_ros(own_handlers=True):
        observer = Observer([encounter.T_target_source for encounter in read_encounters(bag)])
        machine = Machine(bag, folder, seed, seconds)
        try:
            watch.run(observer, machine, schedule(seed, seconds), seconds, stop)
        except Exception as error:
            problem = repr(error)
        code = machine.stop()
        observer.destroy_node()
    report = {
        'minutes': seconds / 60,
        'seconds': round(watch.seconds, 1),
        'seed': seed,
        'faults': dict(sorted(machine.brought.items())),
        **observer.counts,
        'reasons': dict(observer.reasons.most_common()),
        'wrong transforms': observer.wrong,
        'unexplained': observer.unexplained,
        'recording': machine.recordings_failed(),
        'node exit': code,
        'memory_mb': in_short(watch.memory),
        'memory_change': memory_change(watch.memory),
        'problem': 'it was interrupted' if stop.is_set() else problem,
    }
    return report | {'failures': failures(report, seconds), **here}


def failures(report: dict[str, Any], seconds: float) -> list[str]:
    """What of the run was not as it must be."""
    found = []
    if report['problem']:
        found.append(f'the run ended after {report["seconds"]} s: {report["problem"]}')
    elif report['seconds'] < seconds or report['node exit'] != 0:
        found.append(f'the node ended after {report["seconds"]} s, exit {report["node exit"]}')
    if report['unanswered'] or report['not active'] or not report['answers']:
        found.append('the node did not answer, or was not active')
    if report['wrong']:
        found.append(f'{report["wrong"]} of {report["accepted"]} transforms were wrong')
    if not report['accepted']:
        found.append('no transform was accepted')
    if report['unexplained']:
        found.append(f'{len(report["unexplained"])} refusals without a reason')
    if report['recording']:
        found.append(f'recording on a full disk: {report["recording"]}')
    if abs(report['memory_change']) > FLAT:
        found.append(f'memory changed by {report["memory_change"]:+.1%}')
    return found


def main() -> None:
    """Parse the command line, run, report."""
    parser = argparse.ArgumentParser(prog='soak', description=__doc__)
    parser.add_argument('--minutes', type=float, default=60.0)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--folder', type=Path, default=Path('build/soak'), help='scenes and logs')
    parser.add_argument('--out', type=Path, default=None, help='JSON; default: in the folder')
    o = parser.parse_args()
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with bad_input_exits('soak'):
        out = o.out or o.folder / 'soak.json'
        provenance_for(out)
        o.folder.mkdir(parents=True, exist_ok=True)
        report = soak(o.folder, 60 * o.minutes, o.seed, stop)
        write_text(out, json.dumps(report, indent=1) + '\n')
    short = ('accepted', 'strict', 'wrong', 'withheld', 'left out', 'answers', 'memory_change')
    print(', '.join(f'{name} {report[name]}' for name in short))
    print('soak:', '; '.join(report['failures']) or 'the node lived, and nothing was wrong')
    sys.exit(bool(report['failures']))


if __name__ == '__main__':
    main()
