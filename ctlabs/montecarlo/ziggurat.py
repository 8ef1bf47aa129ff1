r"""The normals of numpy's ``Generator(SFC64)``, drawn inside a compiled loop: the same bits, without a call for each.

.. math:: t = a + b + i,\quad a' = b \oplus (b \gg 11),\quad b' = c + (c \ll 3),\quad c' = \mathrm{rot}_{24}(c) + t,\quad i' = i + 1

gives 64 random bits t. Of these, eight choose one of 256 strips of equal area under the density, one the sign, and 52 a place in the
strip, which lies wholly below the density in 99 of 100 cases.

Source: Doornik, *An improved ziggurat method to generate normal random samples* (2005); SFC64: Doty-Humphrey's PractRand; both as in
``numpy/random/src``. The tables are those of numba's own copy of numpy's.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ctlabs.linalg import compiled
from ctlabs.linalg.checks import Array

#: What a loop draws from: compiled, the four words of SFC64; in plain Python numpy's Generator itself.
Stream = Any


def stream(generator: np.random.Generator) -> Stream:
    """What :func:`fill` draws from; it begins where the generator is, and leaves that one alone where it is compiled."""
    if not compiled.COMPILED:
        return generator
    state: Any = generator.bit_generator.state
    return np.array(state["state"]["state"])


def fill(generator: Stream, buffer: Array) -> None:
    """Fill a buffer (columns, width) in the order of ``Generator.standard_normal``."""
    generator.standard_normal(out=buffer)


if compiled.COMPILED:
    from numba.extending import overload
    from numba.np.random import _constants

    #: By strip and sign, the low nine bits, so that nothing branches at random. Places are below 2⁵² and convert by one instruction.
    WIDTHS = np.concatenate([_constants.wi_double, -_constants.wi_double])
    INSIDE = np.tile(_constants.ki_double.astype(np.int64), 2)
    HEIGHTS = _constants.fi_double
    EDGE, PER_EDGE = float(_constants.ziggurat_nor_r), float(_constants.ziggurat_nor_inv_r)
    ONE, THREE, NINE, ELEVEN, LEFT, RIGHT = (np.uint64(i) for i in (1, 3, 9, 11, 24, 40))
    SIGNED, PLACE = np.uint64(0x1FF), np.uint64(0x000FFFFFFFFFFFFF)
    UNIT = 1 / 9007199254740992.0  # 2⁻⁵³

    @partial(compiled.helper, forceinline=True)
    def bits(a: Any, b: Any, c: Any, i: Any) -> tuple[Any, Any, Any, Any, Any]:
        """64 random bits, and the words after them."""
        t = a + b + i
        return t, b ^ (b >> ELEVEN), c + (c << THREE), ((c << LEFT) | (c >> RIGHT)) + t, i + ONE

    @compiled.helper
    def beyond(t: Any, a: Any, b: Any, c: Any, i: Any) -> tuple[float, Any, Any, Any, Any]:
        """The normal of bits whose place is not inside its strip: by the density there, by the tail, or by other bits."""
        while True:
            strip, place = np.int64(t & SIGNED), np.int64((t >> NINE) & PLACE)
            x = place * WIDTHS[strip]
            if place < INSIDE[strip]:
                return x, a, b, c, i
            strip &= 0xFF
            while strip == 0:
                t, a, b, c, i = bits(a, b, c, i)
                away = -PER_EDGE * np.log1p(-np.int64(t >> ELEVEN) * UNIT)
                t, a, b, c, i = bits(a, b, c, i)
                level = -np.log1p(-np.int64(t >> ELEVEN) * UNIT)
                if level + level > away * away:
                    return (-(EDGE + away) if (place >> 8) & 1 else EDGE + away), a, b, c, i
            t, a, b, c, i = bits(a, b, c, i)
            level = np.int64(t >> ELEVEN) * UNIT
            if (HEIGHTS[strip - 1] - HEIGHTS[strip]) * level + HEIGHTS[strip] < np.exp(-0.5 * x * x):
                return x, a, b, c, i
            t, a, b, c, i = bits(a, b, c, i)

    @overload(fill, jit_options={"forceinline": True})
    def _filling(generator: Any, buffer: Any) -> Any:  # noqa: ARG001  # numba passes their types
        """The same of the four words."""

        def compiled_fill(generator: Any, buffer: Any) -> Any:
            a, b, c, i = generator[0], generator[1], generator[2], generator[3]
            for row in range(buffer.shape[0]):
                for r in range(buffer.shape[1]):
                    t, a, b, c, i = bits(a, b, c, i)
                    strip, place = np.int64(t & SIGNED), np.int64((t >> NINE) & PLACE)
                    x = place * WIDTHS[strip]
                    if place >= INSIDE[strip]:
                        x, a, b, c, i = beyond(t, a, b, c, i)
                    buffer[row, r] = x
            generator[0], generator[1], generator[2], generator[3] = a, b, c, i

        return compiled_fill
