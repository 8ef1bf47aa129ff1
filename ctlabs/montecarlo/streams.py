"""The random numbers of an experiment: one stream per block, so that a block is the same wherever and whenever it runs.

The block with number b uses child b of ``SeedSequence(seed)``, split once more into a stream for the states (x0 and w)
and one for the measurements (v): two experiments with the same seed have the same states whatever is measured.
SFC64 is the fastest of numpy's bit generators inside a compiled kernel.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ctlabs.models.histories import Normals, Shape
from ctlabs.montecarlo.plan import Tiling


def generators(seed: int, block: int) -> tuple[np.random.Generator, np.random.Generator]:
    """The streams of one block: for the states, for the measurements."""
    states, measurements = np.random.SeedSequence(seed, spawn_key=(block,)).spawn(2)
    return np.random.Generator(np.random.SFC64(states)), np.random.Generator(np.random.SFC64(measurements))


def tiles(seed: int, block: int, layout: Tiling, shape: Shape, runs: int) -> Iterator[Normals]:
    """What the compiled kernel draws for the first ``runs`` runs of a block, tile by tile."""
    states, measurements = generators(seed, block)
    for begin in range(0, runs, layout.width):
        count = min(layout.width, runs - begin)
        start = states.standard_normal((shape.start, layout.width))
        w = states.standard_normal((shape.steps, shape.w, layout.width))
        v = np.zeros((shape.steps + 1, shape.v, layout.width))
        measurements.standard_normal(out=v[shape.first :])
        yield Normals(start[:, :count], w[:, :, :count], v[:, :, :count])


def normals(seed: int, layout: Tiling, shape: Shape, runs: int) -> Normals:
    """The normals of the first ``runs`` runs of an experiment, over as many blocks as that takes."""
    parts = [
        part
        for block in range(layout.count(runs))
        for part in tiles(seed, block, layout, shape, min(layout.runs, runs - block * layout.runs))
    ]
    return Normals(*(np.concatenate(stack, axis=-1) for stack in zip(*parts, strict=True)))
