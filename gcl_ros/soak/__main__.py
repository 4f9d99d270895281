"""`make soak`: an hour in which everything goes wrong; JSON, and exit code 1 if the node did."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor

from gcl_core.bench.measure import provenance
from gcl_core.data.sequence import positions
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError
from gcl_ros.bag import Encounter, pair_encounters, read_encounters, write_bag
from gcl_ros.session import PROFILE
from gcl_ros.soak.faults import active, schedule
from gcl_ros.soak.machine import Machine
from gcl_ros.soak.observer import Observer

WORLD, KIND = 11, 'mixed'  # a street that training never sees
DISTANCES = (8, 11, 14, 17, 20, 23, 26, 30)  # metres
WARM = 600.0  # seconds until the node is warm; half of a shorter run
FLAT = 0.05  # share by which the node's memory may grow or shrink after it is warm
LOADING = 600.0  # seconds for all processes to load
SAMPLE = 5.0  # seconds between looks at the memory


def scenes() -> list[Encounter]:
    """A vehicle stands in a simulated street; another, facing the same way, drives off."""
    drive = SimulatedSequence(WORLD, kind=KIND)
    where, at = positions(drive), len(drive) // 2
    apart = np.linalg.norm(where[at:] - where[at], axis=1)
    pairs = [(at + int(np.abs(apart - d).argmin()), at) for d in DISTANCES]
    return list(pair_encounters(drive, drive, pairs, 1.0))


def soak(folder: Path, seconds: float, seed: int) -> dict[str, Any]:
    """Run and return the report."""
    bag = folder / 'scenes'
    if not bag.exists():
        write_bag(bag, scenes())
    truths = [encounter.T_target_source for encounter in read_encounters(bag)]
    os.environ.setdefault('FASTDDS_DEFAULT_PROFILES_FILE', str(PROFILE))
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    faults, memory, gone = schedule(seed, seconds), [], 0.0
    with rclpy.init():
        observer, executor = Observer(truths), SingleThreadedExecutor()
        executor.add_node(observer)
        machine, sampled = Machine(bag, folder, seed, seconds), 0.0
        machine.vehicles()
        _wait(observer, executor)
        start = machine.begin()
        while (now := time.time() - start) < seconds and machine.node_alive:
            executor.spin_once(timeout_sec=0.1)
            observer.ask()
            machine.bring(active(faults, now))
            if now - sampled > SAMPLE:
                sampled = now
                memory.append(round(machine.node_mb(), 1))
        gone = time.time() - start
        failed = machine.recording_failed()
        code = machine.stop()
        observer.destroy_node()
    report = {
        'seconds': round(gone, 1),
        'seed': seed,
        'faults': [[f.kind, f.start, f.end, round(f.size, 3)] for f in faults],
        **observer.counts,
        'reasons': dict(observer.reasons.most_common()),
        'wrong transforms': observer.wrong,
        'unexplained': observer.unexplained,
        'recording': failed,
        'node exit': code,
        'memory_mb': memory,
        'memory_change': memory_change(memory),
    }
    return report | {'failures': failures(report, seconds), **provenance()}


def _wait(observer: Observer, executor: Any) -> None:
    """Wait until vehicles and node have found each other."""
    until = time.monotonic() + LOADING
    while not observer.everybody_there:
        executor.spin_once(timeout_sec=0.2)
        if time.monotonic() > until:
            raise GclError(
                f'no node and vehicles within {LOADING:g} s; see the logs in the folder'
            )


def memory_change(memory: list[float]) -> float:
    """Change from the first to the last third of the time in which the node is warm."""
    warm = memory[min(len(memory) // 2, round(WARM / SAMPLE)) :]
    third = len(warm) // 3
    if third == 0:
        return 0.0
    early, late = np.median(warm[:third]), np.median(warm[-third:])
    return round(float(late / early - 1), 4)


def failures(report: dict[str, Any], seconds: float) -> list[str]:
    """What of the run was not as it must be."""
    found = []
    if report['seconds'] < seconds or report['node exit'] != 0:
        found.append(f'the node ended after {report["seconds"]} s, exit {report["node exit"]}')
    if report.get('unanswered', 0) or report.get('not active', 0) or not report.get('answers'):
        found.append('the node did not answer, or was not active')
    if report.get('wrong', 0):
        found.append(f'{report["wrong"]} of {report["accepted"]} transforms were wrong')
    if not report.get('accepted', 0):
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
    o.folder.mkdir(parents=True, exist_ok=True)
    report = soak(o.folder, 60 * o.minutes, o.seed)
    (o.out or o.folder / 'soak.json').write_text(json.dumps(report, indent=1) + '\n')
    short = ('accepted', 'strict', 'wrong', 'withheld', 'left out', 'answers', 'memory_change')
    print(', '.join(f'{name} {report.get(name, 0)}' for name in short))
    print('soak:', '; '.join(report['failures']) or 'the node lived, and nothing was wrong')
    sys.exit(bool(report['failures']))


if __name__ == '__main__':
    main()
