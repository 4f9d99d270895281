"""Breaks whole inputs: bytes, numbers in binary and in text, lengths, order."""

from __future__ import annotations

import re
import struct

import numpy as np

NUMBERS = (0, 1, -1, 2, 127, 128, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**32 - 1, 10**12, 2**63 - 1)
TEXTS = (
    *(str(n) for n in NUMBERS),
    *('nan', 'inf', '-inf', '1e999', '-0', '', ' ', '\n', '\0', '"', '[' * 1500, '{', 'ä', '\xff'),
    *('null', 'true', '[]', '{}', '""', '9' * 400, '!!python/object/apply:os.system [id]', '*a'),
)


def mutated(data: bytes, rng: np.random.Generator, other: bytes = b'') -> bytes:
    """Break an input in one to four places, mostly in one: what is broken twice is read nowhere.

    Args:
        data: whole input.
        rng: draws what is broken.
        other: another input, of which parts are put in.
    """
    for _ in range(1 if rng.random() < 0.5 else int(rng.integers(1, 5))):
        data = CHANGES[int(rng.integers(len(CHANGES)))](data, rng, other)
    return data


def _place(data: bytes, rng: np.random.Generator) -> int:
    """A place, twice as often among the first bytes, where headers are."""
    end = len(data) + 1 if rng.random() < 0.5 else min(len(data) + 1, 200)
    return int(rng.integers(end))


def _flip(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    at, bit = _place(data, rng), 1 << int(rng.integers(8))
    return data[:at] + bytes(b ^ bit for b in data[at : at + 1]) + data[at + 1 :]


def _byte(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    at = _place(data, rng)
    return data[:at] + rng.bytes(1) + data[at + 1 :]


def _number(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    at, size = _place(data, rng), int(rng.choice([1, 2, 4, 8]))
    value = int(rng.choice(np.array(NUMBERS, dtype=object))) % (1 << 8 * size)
    return data[:at] + value.to_bytes(size, 'little') + data[at + size :]


def _float(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    at = _place(data, rng)
    kind = 'f' if rng.random() < 0.5 else 'd'
    value = float(rng.choice([np.nan, np.inf, -np.inf, 3e38, 1e-40, -1e30]))
    return data[:at] + struct.pack(f'<{kind}', value) + data[at + struct.calcsize(kind) :]


def _text(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    """Replace a number or a word of a text."""
    words = list(re.finditer(rb'[\w.+-]+', data[:4000]))
    if not words:
        return data
    word = words[int(rng.integers(len(words)))]
    text = TEXTS[int(rng.integers(len(TEXTS)))].encode()
    return data[: word.start()] + text + data[word.end() :]


def _cut(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    return data[: _place(data, rng)]


def _remove(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    at = _place(data, rng)
    return data[:at] + data[at + int(rng.integers(1, 64)) :]


def _repeat(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    at, size = _place(data, rng), int(rng.integers(1, 64))
    return data[: at + size] + data[at:]


def _splice(data: bytes, rng: np.random.Generator, other: bytes) -> bytes:
    start = _place(other, rng)
    return data[: _place(data, rng)] + other[start : start + int(rng.integers(1, 256))]


def _line(data: bytes, rng: np.random.Generator, _: bytes) -> bytes:
    """Drop, repeat or move a line."""
    lines = data.split(b'\n')
    line = lines.pop(int(rng.integers(len(lines))))
    for _copy in range(int(rng.integers(3))):
        lines.insert(int(rng.integers(len(lines) + 1)), line)
    return b'\n'.join(lines)


CHANGES = (_flip, _byte, _number, _float, _text, _text, _cut, _remove, _repeat, _splice, _line)
