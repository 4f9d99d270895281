"""`make audit`: licences of what is installed for this package, and known vulnerabilities.

Licences come from the packages' own metadata, vulnerabilities from pip-audit (PyPI's advisories),
which is looked for in the folder that `make audit` installs it to. Debian's packages and the code
inside wheels (OpenSSL in Fast DDS's, for instance) are not covered: docs/security.md.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import re
import subprocess
import sys
import tempfile
from importlib import metadata
from typing import Any

NAME = 'gcl_ros'
EXTRAS = ('', 'ros')  # what runs in a vehicle; tools for tests and training do not
UNKNOWN = 'not stated'


def requirements(name: str, extras: tuple[str, ...] = ('',)) -> set[str]:
    """Installed packages that one asks for, on this machine."""
    from packaging.requirements import Requirement

    found = set()
    for text in metadata.requires(name) or []:
        wanted = Requirement(text)
        if wanted.marker is None or any(wanted.marker.evaluate({'extra': e}) for e in extras):
            found.add(re.sub(r'[-_.]+', '-', wanted.name).lower())
    return found


def closure(name: str) -> dict[str, metadata.Distribution]:
    """Everything that a package needs, directly or not, by name."""
    found: dict[str, metadata.Distribution] = {}
    waiting = sorted(requirements(name, EXTRAS))
    while waiting:
        package = waiting.pop()
        if package in found:
            continue
        try:
            found[package] = metadata.distribution(package)
        except metadata.PackageNotFoundError:
            continue
        waiting += requirements(package)
    return dict(sorted(found.items()))


def licence(package: metadata.Distribution) -> str:
    """What a package says of its licence, in a line."""
    said = package.metadata
    classifiers = [
        c.rpartition(' :: ')[2] for c in said.get_all('Classifier') or [] if 'License' in c
    ]
    text = said.get('License-Expression') or '; '.join(classifiers) or said.get('License') or ''
    lines = text.strip().splitlines()
    return lines[0][:80] if lines else UNKNOWN


def vulnerabilities(packages: dict[str, metadata.Distribution]) -> int:
    """Ask pip-audit; 0 if nothing is known, 1 if something is, 2 if nothing could be checked."""
    if importlib.util.find_spec('pip_audit') is None:
        return unchecked('pip-audit is not installed; run `make audit`')
    with tempfile.NamedTemporaryFile('w', suffix='.txt') as file:
        for name, package in packages.items():
            file.write(f'{name}=={package.version.split("+")[0]}\n')
        file.flush()
        command = [sys.executable, '-m', 'pip_audit', '--no-deps', '--disable-pip', '-f', 'json']
        done = subprocess.run([*command, '-r', file.name], capture_output=True, text=True)
    try:
        rows = json.loads(done.stdout)['dependencies']
    except (ValueError, KeyError):
        last = done.stderr.strip().rpartition('\n')[2]
        return unchecked(f'pip-audit failed, is the advisory service in reach? {last[-300:]}')
    return told(rows)


def unchecked(why: str) -> int:
    """Say that nothing is known, which is not that nothing is wrong."""
    print(f'known vulnerabilities NOT CHECKED: {why}')
    return 2


def told(rows: list[dict[str, Any]]) -> int:
    """Print what pip-audit found; what it skipped is not taken for sound."""
    skipped = [row['name'] for row in rows if 'skip_reason' in row]
    if len(skipped) == len(rows):
        return unchecked(
            f'the advisory service answered for none of {len(rows)} packages: is it in reach, or '
            'is a mirror asked in its place?'
        )
    bad = [row for row in rows if row.get('vulns')]
    for row in bad:
        for hole in row['vulns']:
            fixed = ', '.join(hole.get('fix_versions', [])) or 'no version yet'
            print(f'{row["name"]} {row["version"]}: {hole["id"]}, fixed in {fixed}')
    checked = len(rows) - len(skipped)
    print(f'{checked} of {len(rows)} packages checked, {len(bad)} with known vulnerabilities')
    if skipped:
        print(f'NOT CHECKED, unknown to the advisory service: {", ".join(skipped)}')
    return int(bool(bad))


def main() -> None:
    """Print a table of licences, then what is known of vulnerabilities."""
    argparse.ArgumentParser(prog='audit', description=__doc__).parse_args()
    packages = closure(NAME)
    rows = [f'| {name} | {p.version} | {licence(p)} |' for name, p in packages.items()]
    print('\n'.join(['| package | version | licence |', '|---|---|---|', *rows]))
    sys.exit(vulnerabilities(packages))


if __name__ == '__main__':
    main()
