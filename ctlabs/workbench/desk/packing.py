"""Results as text: JSON in which an array is its type, its shape and its compressed bytes, equal to the bit when unpacked.

numpy is loaded only when there is an array.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping
from typing import Any

_ARRAY, _COMPLEX = "__array__", "__complex__"
#: numpy's letters for Booleans, whole numbers, reals and complex numbers that every machine has.
_NUMBERS = "?bBhHiIlLqQefdFD"


def pack(value: Any) -> str:
    """Results as JSON; an array is its type, its shape and its compressed bytes.

    >>> pack({"rms": [1.0, float("inf")], "seed": 1})
    '{"rms":[1.0,Infinity],"seed":1}'
    """
    return json.dumps(_plain(value, "results"), separators=(",", ":"))


def unpack(text: str) -> Any:
    """What :func:`pack` packed.

    >>> import numpy as np
    >>> unpack(pack({"x": np.eye(2)}))["x"]
    array([[1., 0.],
           [0., 1.]])
    """
    return json.loads(text, object_hook=_rebuilt)


def _plain(value: Any, where: str) -> Any:
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, complex):
        return {_COMPLEX: [value.real, value.imag]}
    if isinstance(value, Mapping):
        wrong = [key for key in value if not isinstance(key, str) or key in {_ARRAY, _COMPLEX}]
        if wrong:
            msg = f"{where}: expected names for keys, received {wrong[0]!r}"
            raise TypeError(msg)
        return {key: _plain(each, f"{where}.{key}") for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each, f"{where}[{i}]") for i, each in enumerate(value)]
    return _array(value, where)


def _array(value: Any, where: str) -> Any:
    import numpy as np

    known = isinstance(value, np.ndarray | np.generic) and value.dtype.char in _NUMBERS
    if known and isinstance(value, np.generic):
        return _plain(value.item(), where)
    if not known:
        kind = f"an array of {value.dtype}" if isinstance(value, np.ndarray) else f"a {type(value).__name__}"
        msg = f"{where}: expected numbers, texts, lists, dicts or arrays of numbers, received {kind}"
        raise TypeError(msg)
    little = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
    # Level 1: noise hardly compresses, and what does (constants, symmetric matrices) does so at any level.
    data = base64.b64encode(zlib.compress(little.tobytes(), 1)).decode("ascii")
    return {_ARRAY: [little.dtype.str, list(value.shape), data]}


def _rebuilt(found: dict[str, Any]) -> Any:
    if _COMPLEX in found:
        return complex(*found[_COMPLEX])
    if _ARRAY not in found:
        return found
    import numpy as np

    kind, shape, data = found[_ARRAY]
    result = np.frombuffer(zlib.decompress(base64.b64decode(data)), dtype=kind).reshape(shape)
    return result.astype(result.dtype.newbyteorder("="))
