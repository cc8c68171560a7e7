"""Which impacts a motion that sticks makes, and orbits with one more or fewer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array
from dynkit.orbits.equations import Problem
from dynkit.systems.impact.sticking.passage import Word
from dynkit.systems.impact.sticking.watching import items, lowest_gap

if TYPE_CHECKING:
    from dynkit.systems.impact.sticking.problem import StickingProblem


def neighbours_of(
    problem: StickingProblem, event: int, x: Array, p: Array
) -> list[tuple[Problem, Array, Array]]:
    """The same motion with an impact added where a gap touches, or left out where it vanishes."""
    passages = problem.passages(x, p)
    w = items(passages)[event]
    passage, word = passages[w.passage], problem.words[w.passage]
    sides, phases = list(word.sides), passage.phases[:-1]
    if w.what == "impact" and w.number < len(sides) - 1:
        del sides[w.number]
        phases = np.delete(phases, w.number + 1)
    elif w.what == "flight":
        _, since, _ = lowest_gap(passage, w.number, w.side)
        at = passage.phases[w.number] + passage.w * since
        sides.insert(w.number, w.side)
        phases = np.insert(phases, w.number + 1, at)
    else:
        return []
    words = list(problem.words)
    words[w.passage] = Word(word.start, tuple(sides))
    parts: list[Any] = [np.append(a, b[:-1]) for a, b in problem.parts(x)]
    parts[w.passage] = np.append(problem.parts(x)[w.passage][0], phases)
    return [(problem.of_words(tuple(words)), np.concatenate(parts), p)]
