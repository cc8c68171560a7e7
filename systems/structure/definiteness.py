"""Checks that a symmetric matrix is positive definite or semidefinite, as an energy requires."""

import numpy as np

from dynkit.core.validation import Array


def check_definite(name: str, matrix: Array) -> None:
    """Raise an error if a matrix is not positive definite up to rounding.

    Parameters
    ----------
    name : str
        Name of the matrix in the error message.
    matrix : array, shape (N, N)
        Finite and symmetric.

    Raises
    ------
    ValueError
        When a diagonal element is not positive, or when the matrix, after scaling of rows and
        columns to a diagonal of ones, has an eigenvalue below N ulp.

    Examples
    --------
    >>> check_definite("mass", np.diag([1.0, 0.0]))
    Traceback (most recent call last):
    ...
    ValueError: mass must be positive definite; got 0.0 at [1, 1]
    """
    _check(name, matrix, definite=True)


def check_semidefinite(name: str, matrix: Array) -> None:
    """Raise an error if a matrix is not positive semidefinite up to rounding.

    Parameters
    ----------
    name : str
        Name of the matrix in the error message.
    matrix : array, shape (N, N)
        Finite and symmetric.

    Raises
    ------
    ValueError
        When a diagonal element is negative, or when it is zero in a row that is not zero, or when
        the matrix, after scaling of rows and columns to a diagonal of ones, has an eigenvalue below
        -4 N ulp.

    Examples
    --------
    >>> check_semidefinite("stiffness", np.array([[1.0, -2.0], [-2.0, 1.0]]))
    Traceback (most recent call last):
    ...
    ValueError: stiffness must be positive semidefinite; got the eigenvalue -1.0
    """
    _check(name, matrix, definite=False)


def _check(name: str, matrix: Array, *, definite: bool) -> None:
    wanted = "positive definite" if definite else "positive semidefinite"
    diagonal = np.diagonal(matrix)
    wrong = diagonal <= 0.0 if definite else diagonal < 0.0
    if wrong.any():
        place = int(np.argmax(wrong))
        value = float(diagonal[place])
        raise ValueError(f"{name} must be {wanted}; got {value} at [{place}, {place}]")
    if np.count_nonzero(matrix) == np.count_nonzero(diagonal):
        return
    # Scaling makes the check independent of the units of the coordinates.
    lengths = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = matrix / lengths[:, None] / lengths
    margin = len(matrix) * np.finfo(np.float64).eps * (-1.0 if definite else 4.0)
    try:
        np.linalg.cholesky(scaled + margin * np.eye(len(matrix)))
    except np.linalg.LinAlgError:
        # Rounding may make the factorisation fail if an eigenvalue is close to the margin.
        if float(np.linalg.eigvalsh(scaled)[0]) < -margin:
            lowest = float(np.linalg.eigvalsh(matrix)[0])
            raise ValueError(f"{name} must be {wanted}; got the eigenvalue {lowest:.6}") from None
