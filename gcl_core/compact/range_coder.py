"""A binary range coder: decisions of known probability to bytes and back (Martin, 1979).

The interval [low, high] is cut in proportion to the probability; bytes on which both ends agree
are written. Integers of 32 bits, no carry.
"""

from __future__ import annotations

MASK = 0xFFFFFFFF
TOP = 0xFF000000


class RangeEncoder:
    """Writes decisions."""

    def __init__(self) -> None:
        self._low, self._high = 0, MASK
        self._out = bytearray()

    def code(self, bit: int, probability: int) -> int:
        """Write a decision whose probability of 1 is `probability` of 65,536; returns it."""
        middle = self._low + ((self._high - self._low) * probability >> 16)
        if bit:
            self._high = middle
        else:
            self._low = middle + 1
        while (self._low ^ self._high) & TOP == 0:
            self._out.append(self._high >> 24)
            self._low = self._low << 8 & MASK
            self._high = (self._high << 8 | 255) & MASK
        return bit

    def finish(self) -> bytes:
        """End the stream."""
        return bytes(self._out) + self._low.to_bytes(4, 'big')


class RangeDecoder:
    """Reads decisions; behind the end of the data it reads zeros."""

    def __init__(self, data: bytes) -> None:
        self._low, self._high = 0, MASK
        self._data = iter(data)
        self._code = 0
        for _ in range(4):
            self._code = self._code << 8 | next(self._data, 0)

    def code(self, _: int, probability: int) -> int:
        """Read the decision that was written with this probability."""
        middle = self._low + ((self._high - self._low) * probability >> 16)
        bit = int(self._code <= middle)
        if bit:
            self._high = middle
        else:
            self._low = middle + 1
        while (self._low ^ self._high) & TOP == 0:
            self._low = self._low << 8 & MASK
            self._high = (self._high << 8 | 255) & MASK
            self._code = (self._code << 8 | next(self._data, 0)) & MASK
        return bit
