"""LZF, which compressed .pcd files are written in."""

from __future__ import annotations

from gcl_core.errors import GclError

LITERAL = 32  # control bytes below it are a run of bytes, others refer to what came before


def decompressed(data: bytes, size: int) -> bytes:
    """The first `size` bytes of what was compressed; no more than 264 beyond are ever held.

    Raises:
        GclError: the data end before, or refer to what is not there.
    """
    out = bytearray()
    at = 0
    try:
        while len(out) < size:
            control = data[at]
            at += 1
            if control < LITERAL:
                out += data[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += data[at]
                at += 1
            back = ((control & 31) << 8) + data[at] + 1
            at += 1
            if back > len(out):
                raise GclError('compressed data refer to bytes before the first; export it anew')
            start, length = len(out) - back, length + 2
            if length <= back:
                out += out[start : start + length]
            else:  # of what it writes itself
                out += (out[start:] * (length // back + 1))[:length]
    except IndexError:
        raise GclError(f'compressed data end after {len(out)} of {size} bytes') from None
    return bytes(out[:size])
