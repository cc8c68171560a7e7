from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import sympy

from dynkit.systems.structure import energies
from dynkit.systems.structure.chain import chain_links
from dynkit.systems.structure.energies import quadratic_form, symbols

X = symbols("x", 3)
A, B, C = X
I, K, PI = sympy.I, sympy.Symbol("k"), sympy.pi  # noqa: E741


def matrix(expression: Any) -> list[list[float]]:
    found: list[list[float]] = quadratic_form("potential", expression, X).dense.tolist()
    return found


@pytest.mark.parametrize(
    ("expression", "wanted"),
    [
        (A**2, [[2, 0, 0], [0, 0, 0], [0, 0, 0]]),
        (A * C, [[0, 0, 1], [0, 0, 0], [1, 0, 0]]),
        (0.1 * (A - B) ** 2, [[0.2, -0.2, 0], [-0.2, 0.2, 0], [0, 0, 0]]),
        (A * (B + 2 * C) / 4, [[0, 0.25, 0.5], [0.25, 0, 0], [0.5, 0, 0]]),
        (PI * (A**2 + 3 * B**2), [[2 * np.pi, 0, 0], [0, 6 * np.pi, 0], [0, 0, 0]]),
        (sympy.sqrt(2) * A**2 / 2, [[np.sqrt(2), 0, 0], [0, 0, 0], [0, 0, 0]]),
        (A**2.0, [[2, 0, 0], [0, 0, 0], [0, 0, 0]]),
        (np.float64(0.1) * A**2, [[0.2, 0, 0], [0, 0, 0], [0, 0, 0]]),
        (A**2 / 3, [[2 / 3, 0, 0], [0, 0, 0], [0, 0, 0]]),
        (sympy.Abs(A) ** 2, [[2, 0, 0], [0, 0, 0], [0, 0, 0]]),
    ],
)
def test_matrices_of_quadratic_forms(expression: Any, wanted: list[list[float]]) -> None:
    assert matrix(expression) == wanted


@pytest.mark.parametrize("nothing", [0, 0.0, sympy.Integer(0), 7, np.float64(2.5), sympy.pi])
def test_a_constant_potential_has_no_stiffness(nothing: Any) -> None:
    assert matrix(nothing) == np.zeros((3, 3)).tolist()


def test_linear_terms_may_cancel_each_other() -> None:
    assert matrix((A - 1) ** 2 / 2 + (A + 1) ** 2 / 2) == matrix(A**2)


def test_higher_terms_may_cancel_each_other() -> None:
    assert matrix(A**2 * (1 + B) - A**2 * B) == matrix(A**2)


def test_floats_are_the_binary_fractions_that_they_are() -> None:
    # In floats the square of (0.1 a - 0.7 b) would round 2 * 0.1 * 0.7.
    found = quadratic_form("potential", (0.1 * A - 0.7 * B) ** 2 / 2, X)
    exact = -Fraction(0.1) * Fraction(0.7)
    assert found.dense[0, 1] == float(exact)


def test_an_element_keeps_what_its_rounding_loses() -> None:
    found = quadratic_form("potential", (A**2 + 1e-20 * (A - B) ** 2) / 2, X)
    assert (found.high[0], found.low[0]) == (1.0, 1e-20)


def test_a_sum_of_many_terms_is_rounded_once() -> None:
    strengths = [1.0, 2.0**-53, 2.0**-53, 2.0**-53, 2.0**-53]
    other = [2**k * A + B for k in range(5)]
    terms = [s * x**2 / 2 for s, x in zip(strengths, other, strict=True)]
    assert quadratic_form("potential", sympy.Add(*terms), X).dense[1, 1] == 1.0 + 2.0**-51


def test_every_term_is_read_once_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    products: list[int] = []
    plain = energies.product

    def counted(parts: Any) -> Any:
        found = plain(parts)
        products.append(len(found))
        return found

    monkeypatch.setattr(energies, "product", counted)
    work = []
    for size in (50, 100):
        products.clear()
        x = symbols("x", size)
        quadratic_form("potential", chain_links((0.3,) * size, x), x)
        work.append((len(products), sum(products)))
    # From N = 50 to N = 100 both the products and their terms double, up to the first link's few.
    assert all(abs(second - 2 * first) <= 9 for first, second in zip(*work, strict=True))


def test_nothing_is_differentiated(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise AssertionError("a symbolic derivative was taken")

    monkeypatch.setattr(sympy.Expr, "diff", refused)
    assert matrix(A**2)[0][0] == 2.0


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        (A**2 + 3 * B, r"the term 3\*x_2 is of degree 1"),
        ((A - 1) ** 2, r"the term \(x_1 - 1\)\*\*2 is of degree 1"),
        (A**2 + 0.5 * B**4, r"the term 0\.5\*x_2\*\*4 is of degree 4"),
        (A**2 + (A + B) ** 2 * C, r"is of degree 3"),
        (A**2 + B**7, r"the term x_2\*\*7 holds x_2\*\*7, which is of too high a degree"),
        (A**3 * B**3, "is of degree 6"),
        (A**2 + 1 / B, "the term 1/x_2 holds 1/x_2, which is not a polynomial"),
        (A**2 + sympy.sqrt(B), r"holds sqrt\(x_2\), which is not a polynomial"),
        (A**2 + sympy.cos(C), r"the term cos\(x_3\) holds cos\(x_3\), which is not a polynomial"),
        (2**A, r"holds 2\*\*x_1, which is not a polynomial"),
        (A**2 + K * B**2, r"the term k\*x_2\*\*2 holds k, which is not among them"),
        (A**2 + symbols("v", 1)[0] ** 2, r"the term v_1\*\*2 holds v_1, which is not among them"),
        (I * A**2, "has the coefficient I, which is not a real number"),
        (A**2 + sympy.sqrt(-2) * B**2, "which is not a real number"),
        (sympy.nan * A**2, "has the coefficient nan, which is not finite"),
        (float("nan") * A**2, "has the coefficient nan, which is not finite"),
        (float("inf") * A**2, "has the coefficient oo, which is not finite"),
        (sympy.zoo * A**2, "which is not finite"),
        (float("nan"), "which is not finite"),
        (sympy.Float("1e400") * A**2, "a coefficient exceeds the range of floats"),
    ],
)
def test_what_is_no_quadratic_form_is_refused(expression: Any, message: str) -> None:
    with pytest.raises(ValueError, match=r"potential must be a quadratic form in .*" + message):
        matrix(expression)


@pytest.mark.parametrize("nothing", [None, "x_1**2", True, [A**2], sympy.eye(2), A > 0])
def test_what_is_no_expression_is_refused(nothing: Any) -> None:
    with pytest.raises(ValueError, match="potential must return a SymPy expression; got"):
        matrix(nothing)


def test_a_constant_kinetic_energy_is_refused() -> None:
    with pytest.raises(
        ValueError, match=r"kinetic must be a quadratic .*; the term 3 is a constant"
    ):
        quadratic_form("kinetic", A**2 + 3, X)


def test_long_terms_are_shown_shortened() -> None:
    x = symbols("x", 50)
    with pytest.raises(ValueError, match=r"in x_1, \.\.\., x_50; the term .{77}\.\.\. is of"):
        quadratic_form("potential", (sympy.Add(*x) + 1) ** 2, x)
