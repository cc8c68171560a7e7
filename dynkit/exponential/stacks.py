"""Exponential sums of many states, put into arrays that kernels take as one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np


def stacked(groups: Sequence[Sequence[Any]]) -> Any:
    """The `Ladders` of groups of sums, one sum at least in each; those of a group share a state."""
    from dynkit.exponential.stack_kernels import Ladders

    firsts = [group[0] for group in groups]
    sums = [(g, ladder) for g, group in enumerate(groups) for ladder in group]
    each = [ladder for _, ladder in sums]
    return Ladders(
        step=_filled([ladder.step for ladder in firsts]),
        generator=_filled([ladder.generator for ladder in firsts]),
        links=_filled([ladder.links for ladder in firsts]),
        link_step=_filled([ladder.link_step for ladder in firsts]),
        smallest=np.array([ladder.smallest for ladder in firsts]),
        sizes=np.array([(len(ladder.step), len(ladder.links)) for ladder in firsts]),
        cell=_filled([ladder.cell for ladder in each]),
        rows=_filled([ladder.rows for ladder in each]),
        integers=np.array([_integers(g, ladder) for g, ladder in sums]),
        numbers=np.array([(ladder.offset, ladder.window, ladder.swing) for ladder in each]),
    )


def _integers(group: int, ladder: Any) -> tuple[int, ...]:
    flags = int(ladder.apart), int(ladder.grows)
    return group, len(ladder.cell), ladder.smooth, *flags, ladder.steady


def _filled(arrays: Sequence[Any]) -> Any:
    """Arrays (k, ...) one after another, filled up with zeros to the largest of them."""
    if len(arrays) == 1:
        return arrays[0][None]
    shapes = [array.shape for array in arrays]
    out = np.zeros((len(arrays), *np.max(shapes, axis=0)), dtype=arrays[0].dtype)
    for place, array in zip(out, arrays, strict=True):
        place[tuple(map(slice, array.shape))] = array
    return out
