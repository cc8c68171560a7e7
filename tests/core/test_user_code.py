"""The digest of a user's class: what changes it, and what does not."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynkit import sweep
from dynkit.core.user_code import code_of, reading_of

HELPERS = """
def cubed(x):
    return x * x * x
"""

SOURCE = '''
import functools
import math
from dataclasses import dataclass
from typing import ClassVar

import numba
import numpy as np

import of_own_helpers
from dynkit import Map
from of_own_helpers import cubed

GAIN = 2.0
TABLE = np.array([1.0, 2.0])
CALLS = 0


def doubled(function):
    @functools.wraps(function)
    def wrapper(*arguments):
        return 2.0 * function(*arguments)

    return wrapper


def inner(x):
    return x + 1.0


def helper(x):
    return inner(x)


@numba.njit
def compiled(x):
    return x


class Constants:
    scale = 3.0


def unused(x):
    return x


def made(factor):
    class Own(Map):
        rate: float = 3.2
        dimension = 1
        limits: ClassVar[tuple[float, ...]] = (0.0, 1.0)
        counted: ClassVar[int] = 0

        def __call__(self, state, shift=0.5):
            """Return the next state."""
            global CALLS
            CALLS += 1
            type(self).counted += 1
            known = [each for each in (lambda: {1.0, 2.0})() if each in {1.0, 2.0}]
            number = helper(GAIN) + compiled(TABLE[0]) + cubed(1.0) + of_own_helpers.cubed(2.0)
            found = self.more(state) * Constants.scale * factor + shift * number + known[0]
            return np.array([found])

        @doubled
        def more(self, x):
            return math.sin(x[0])

    return Own


Own = made(0.5)
'''

CHANGES = {
    "a method": ("return math.sin", "return math.cos"),
    "a default argument": ("shift=0.5", "shift=0.25"),
    "a constant of the module": ("GAIN = 2.0", "GAIN = 4.0"),
    "an array of the module": ("array([1.0, 2.0])", "array([1.0, 3.0])"),
    "a function of a function": ("x + 1.0", "x + 2.0"),
    "a function of Numba": ("compiled(x):\n    return x", "compiled(x):\n    return -x"),
    "a closure": ("made(0.5)", "made(0.75)"),
    "a decorator": ("2.0 * function", "3.0 * function"),
    "a constant of another class": ("scale = 3.0", "scale = 4.0"),
    "a constant of the class": ("(0.0, 1.0)", "(0.0, 2.0)"),
    "a constant of a nested function": ("lambda: {1.0, 2.0}", "lambda: {1.0, 3.0}"),
    "a function of a library": ("import math", "import numpy as math"),
}
"""For what changes the digest, a part of the source and its replacement."""

SAME = {
    "a comment": ("global CALLS", "global CALLS  # counted"),
    "a docstring": ("Return the next state", "Return another state"),
    "a function that it does not call": ("unused(x):\n    return x", "unused(x):\n    return -x"),
    "a default of a field": ("rate: float = 3.2", "rate: float = 3.3"),
    "a number that a method counts": ("CALLS = 0", "CALLS = 7"),
    "a number of the class that a method counts": ("[int] = 0", "[int] = 7"),
}


@pytest.fixture(autouse=True)
def own_modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # files change within a second
    _written(tmp_path, "of_own_helpers", HELPERS)
    yield
    for name in ("of_own_helpers", "of_own"):
        sys.modules.pop(name, None)


def _written(folder: Path, name: str, source: str) -> Any:
    path = folder / f"{name}.py"
    path.write_text(source)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def _own(folder: Path, source: str = SOURCE) -> Any:
    return _written(folder, "of_own", source).Own


@pytest.mark.parametrize(("before", "after"), CHANGES.values(), ids=list(CHANGES))
def test_what_a_class_calls_is_part_of_its_digest(before: str, after: str, tmp_path: Path) -> None:
    assert SOURCE.count(before) == 1
    digest = code_of(_own(tmp_path))
    assert digest != code_of(_own(tmp_path, SOURCE.replace(before, after))) != ""


@pytest.mark.parametrize(("before", "after"), SAME.values(), ids=list(SAME))
def test_what_does_not_change_its_motions_is_no_part(
    before: str, after: str, tmp_path: Path
) -> None:
    assert SOURCE.count(before) == 1
    digest = code_of(_own(tmp_path))
    assert digest == code_of(_own(tmp_path, SOURCE.replace(before, after))) != ""


def test_a_function_of_another_module_is_part_of_it(tmp_path: Path) -> None:
    digest = code_of(_own(tmp_path))
    _written(tmp_path, "of_own_helpers", HELPERS.replace("x * x * x", "x**3"))
    assert code_of(_own(tmp_path)) != digest


def test_the_digest_is_the_same_in_other_processes_and_after_calls(tmp_path: Path) -> None:
    kind = _own(tmp_path)
    digest = code_of(kind)
    for _ in range(3):
        kind()(np.array([0.3]))
    assert code_of(kind) == digest
    asked = "from dynkit.core.user_code import code_of; import of_own; print(code_of(of_own.Own))"
    for seed in ("1", "2"):
        done = subprocess.run(
            [sys.executable, "-c", asked],
            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": os.pathsep.join(sys.path)},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout.strip() == digest


def test_functions_that_call_each_other_have_a_digest(tmp_path: Path) -> None:
    mutual = SOURCE.replace("return x + 1.0", "return x + 1.0 if x else helper(x)")
    assert code_of(_own(tmp_path, mutual)) != code_of(_own(tmp_path))


def test_what_is_replaced_is_read_again(tmp_path: Path) -> None:
    kind = _own(tmp_path)
    module, first = sys.modules["of_own"], reading_of(kind)
    assert reading_of(kind) is first
    vars(module)["GAIN"] = 4.0
    assert reading_of(kind) is not first
    vars(module)["GAIN"] = 2.0
    assert code_of(kind) == first.digest
    kind.more = lambda self, x: x
    assert code_of(kind) != first.digest


def test_a_store_is_refused_where_a_function_of_its_module_has_changed(tmp_path: Path) -> None:
    store, given = tmp_path / "own.h5", dict[str, Any](start=[0.3], progress=False)
    sweep(_own(tmp_path)(), "rate", [3.2], store=store, **given)
    sweep(_own(tmp_path)(), "rate", [3.2], store=store, **given)
    changed = _own(tmp_path, SOURCE.replace("x + 1.0", "x + 2.0"))
    with pytest.raises(ValueError, match="was made with code"):
        sweep(changed(), "rate", [3.2], store=store, **given)


def test_a_constant_of_the_module_that_an_energy_names_counts_when_it_changes(
    tmp_path: Path,
) -> None:
    source = """
from dynkit.systems import ImpactChain

SPRING = 1.0


class Own(ImpactChain):
    def potential(self, x):
        return super().potential(x) + SPRING * x[0] ** 2
"""
    kind = _own(tmp_path, source)
    assert kind(masses=2, frequency=0.9).stiffness[0, 0] == 4.0
    vars(sys.modules["of_own"])["SPRING"] = 2.0
    assert kind(masses=2, frequency=0.9).stiffness[0, 0] == 6.0


def test_a_constant_of_the_module_that_an_expression_names_counts_when_it_changes(
    tmp_path: Path,
) -> None:
    source = """
from dynkit.systems import SymbolicMap

RATE = 1.0


class Own(SymbolicMap):
    factor: float = 1.0

    def next_state(self, x):
        return (self.factor * RATE * x,)
"""
    kind = _own(tmp_path, source)
    assert kind()(np.array([0.25])).tolist() == [0.25]
    vars(sys.modules["of_own"])["RATE"] = 2.0
    assert kind()(np.array([0.25])).tolist() == [0.5]
