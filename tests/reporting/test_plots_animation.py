"""The animation of a field: one frame a time shown, refused where shapes do not fit."""

import io

import numpy as np
import pytest
from PIL import Image

from ctlabs.reporting import plots

X, T = np.arange(5.0), np.arange(6.0)


def test_every_time_shown_is_a_frame():
    """Six times, every second shown: three frames, and the field moves from one to the next."""
    moving = np.sin(X[None, :] + T[:, None])
    gif = Image.open(
        io.BytesIO(
            plots.animation(X, T, {"truth": moving, "measurement": moving + 0.1}, xlabel="x, m", ylabel="z, u", every=2)
        )
    )
    assert gif.n_frames == 3
    frames = []
    for k in range(3):
        gif.seek(k)
        frames.append(np.asarray(gif.convert("RGB")))
    assert not np.array_equal(frames[0], frames[1])


def test_gaps_are_allowed_and_shapes_are_not_guessed():
    """NaN is a gap; a field of another shape is refused in one line."""
    gap = np.where(X == 2, np.nan, T[:, None] + X)
    assert plots.animation(X, T, {"measurement": gap}, xlabel="x, m", ylabel="z, u", every=5)[:3] == b"GIF"
    with pytest.raises(ValueError, match=r"truth: expected shape \(6, 5\) \(times, nodes\), received \(5, 6\)"):
        plots.animation(X, T, {"truth": gap.T}, xlabel="x, m", ylabel="z, u")
