"""A model as a part of an address: whoever opens the link has the model on the desk, on any machine, and nothing is kept for it here.

>>> unpacked(packed('title = "x"'))
'title = "x"'
"""

from __future__ import annotations

import base64
import binascii
import zlib

#: Characters of a model file, and of an address that browsers and servers take.
LARGEST, LONGEST = 1_000_000, 30_000


def packed(text: str) -> str:
    """The text in letters that an address may have.

    Raises
    ------
    ValueError
        It is too long for an address.
    """
    made = base64.urlsafe_b64encode(zlib.compress(text.encode(), 9)).decode().rstrip("=")
    if len(made) > LONGEST:
        msg = f"link: expected a model of at most {LONGEST} packed characters, received {len(made)}: send its file"
        raise ValueError(msg)
    return made


def unpacked(link: str) -> str:
    """The text of :func:`packed`'s answer.

    Raises
    ------
    ValueError
        Something else, or a part of it; one line.

    >>> unpacked("x")
    Traceback (most recent call last):
    ...
    ValueError: link: expected one that was copied whole, received another text
    """
    msg = "link: expected one that was copied whole, received another text"
    try:
        inflate = zlib.decompressobj()
        found = inflate.decompress(base64.b64decode(link + "=" * (-len(link) % 4), altchars=b"-_", validate=True), LARGEST)
        whole = inflate.eof and not inflate.unused_data
        text = found.decode()
    except (binascii.Error, zlib.error, UnicodeError, ValueError):
        raise ValueError(msg) from None
    if not whole:
        raise ValueError(msg)
    return text
