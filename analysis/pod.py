"""Proper orthogonal decomposition: the modes with most of a motion's power."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from dynkit.analysis.averages import batch_errors
from dynkit.analysis.pod_averages import Averages, KnowsAverages, averages_of, change_of
from dynkit.analysis.pod_figures import draw_cumulative, draw_modes
from dynkit.analysis.regimes import RegimeChange
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.validation import (
    Array,
    finite_array,
    in_interval,
    one_of,
    positive,
    positive_integer,
    read_only,
)
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Share of the power for the rank in the repr.
_SHARE = 0.99


@final
class POD(Saved):
    """Proper orthogonal decomposition of R, the time average of x x^T.

    The eigenvectors of R are the proper orthogonal modes, its eigenvalues the powers (mean squares)
    of the modes.

    Parameters
    ----------
    source : ImpactAttractor, ImpactRecord, Attractor or (k, N) array_like
        For an impact attractor or record the average is exact, from the start to the last impact:
        flights, chatter and contact in closed form, without sampling. If a multiple of n impacts
        was kept, it is the average of the periodic orbit P(n,m). For other attractors it is the
        average of the states. An array contains samples, one in each row.
    times : (k,) array_like, optional
        Times of the samples, ascending, for an average by the trapezoidal rule. By default all
        samples have the same weight.
    about : {"origin", "mean"}
        Whether the moments are about the origin, as in the paper, or about the mean.

    Raises
    ------
    ValueError
        When samples are not finite, fewer than two, or all of them zero; when times do not ascend.

    References
    ----------
    J. P. Cusumano, B.-Y. Bai, Chaos, Solitons & Fractals 3 (1993) 515-535, section 5. P. Holmes, J.
    L. Lumley, G. Berkooz, C. W. Rowley, Turbulence, Coherent Structures, Dynamical Systems and
    Symmetry, 2nd edition (2012), chapter 3.

    Examples
    --------
    >>> t = np.linspace(0.0, 1.0, 101)[1:]
    >>> x = np.stack([np.sin(2 * np.pi * t), np.cos(2 * np.pi * t) / 7.0], axis=1)
    >>> pod = POD(x)
    >>> pod.power.round(6).tolist()
    [0.5, 0.010204]
    >>> pod.rank(0.9), pod.rank(0.99)
    (1, 2)
    """

    _stored: ClassVar = ("about", "_normal_modes", "_averages", "change")
    about: str
    _normal_modes: Array | None

    def __init__(
        self,
        source: object,
        times: object = None,
        *,
        about: Literal["origin", "mean"] = "origin",
    ) -> None:
        self.about: str = one_of("about", about, ("origin", "mean"))
        self._normal_modes = getattr(getattr(source, "system", None), "modal_matrix", None)
        self._averages_of = averages_of(source, times)
        self._change_of = partial(change_of, source)
        if not isinstance(source, KnowsAverages):  # bad samples are refused at once
            self.matrix  # noqa: B018

    def __repr__(self) -> str:
        if "_averages" not in vars(self):
            return f"<POD about the {self.about}, not computed yet>"
        share, rank = f"{100.0 * _SHARE:g} % of the power", self.rank(_SHARE)
        doubt = "" if self.change is None else f"; {self.change}"
        return f"<POD about the {self.about}: {share} in {rank} of {len(self.power)} modes{doubt}>"

    @cached_property
    def _averages(self) -> Averages:
        found = self._averages_of()
        return Averages(*(getattr(found, entry.name) for entry in fields(Averages)))

    @cached_property
    def _products(self) -> Array:
        """Integrals (b, N, N) of x x^T over each batch, about the origin or the mean."""
        averages, mean = self._averages, self.mean
        if self.about == "origin":
            return averages.products
        mixed = averages.sums[:, :, None] * mean
        whole = averages.durations[:, None, None] * np.outer(mean, mean)
        return np.asarray(averages.products - mixed - mixed.transpose(0, 2, 1) + whole)

    @cached_property
    def mean(self) -> Array:
        """Time average of x, (N,)."""
        return read_only(self._averages.sums.sum(axis=0) / self._averages.durations.sum())

    @cached_property
    def matrix(self) -> Array:
        """R, (N, N), about the origin or the mean.

        Raises
        ------
        ValueError
            When R is zero, or no larger than rounding.
        """
        matrix = self._products.sum(axis=0) / self._averages.durations.sum()
        found = float(np.trace(matrix))
        least = 4.0 * len(matrix) * 2.0**-52 * self._mean_square
        if not found > least:
            raise ValueError(
                f"source must move about its {self.about} by a mean square of more than rounding, "
                f"{least:g}; got {found:g}"
            )
        return read_only(0.5 * (matrix + matrix.T))

    @property
    def _mean_square(self) -> float:
        averages = self._averages
        return float(np.trace(averages.products.sum(axis=0)) / averages.durations.sum())

    @property
    def error(self) -> float:
        """Bound, to leading order, of the error of any power as an average over this motion.

        It includes rounding, the remainders of chatters, and, with times, the error of the
        trapezoidal rule, from second differences of the samples. With fewer than about ten samples
        in the shortest period this may be too small; with two samples it is infinite. For the
        difference to another part of the same motion see `standard_errors`.
        """
        averages, entry = self._averages, self._averages.error
        if self.about == "mean":
            entry += 2.0 * float(abs(self.mean).max()) * averages.mean_error
        return len(self.mean) * (entry + 2.0**-52 * self._mean_square)

    @property
    def cost(self) -> Cost:
        """Seconds, and numbers of impacts or samples, and of nodes of quadrature."""
        return self._averages.cost

    @cached_property
    def _eigen(self) -> tuple[Array, Array]:
        values, vectors = np.linalg.eigh(self.matrix)
        power, modes = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
        modes = modes * np.where(modes[-1] < 0.0, -1.0, 1.0)
        return read_only(power), read_only(modes)

    def dataset(self) -> Dataset:
        """Return powers and modes as a dataset over ``mode`` and ``coordinate``, from 1."""
        count = np.arange(1, len(self.power) + 1)
        return Dataset(
            {"mode": ("mode", count), "coordinate": ("coordinate", count)},
            {
                "power": ("mode", self.power),
                "standard_error": ("mode", self.standard_errors),
                "cumulative": ("mode", self.cumulative),
                "shape": (("coordinate", "mode"), self.modes),
                "mean": ("coordinate", self.mean),
            },
            described(
                f"Proper orthogonal modes about the {self.about}",
                cost=self.cost,
                error="bound of the error of any power as an average over this motion",
                power_error=self.error,
                batches=float(self.batches),
            ),
        )

    @property
    def power(self) -> Array:
        """Mean squares of the modal amplitudes, (N,), descending: the eigenvalues of R."""
        return self._eigen[0]

    @property
    def modes(self) -> Array:
        """Proper orthogonal modes, (N, N), one per column, of length one, last entry not negative.

        Modes whose powers differ by less than their errors are not determined separately.
        """
        return self._eigen[1]

    @cached_property
    def cumulative(self) -> Array:
        """Share of the total power in the first mode, the first two, ..., (N,); the last is 1."""
        total = np.cumsum(self.power)
        return np.asarray(total / total[-1])

    def rank(self, share: float) -> int:
        """Return the number of modes that hold at least this share of the power.

        Parameters
        ----------
        share : float
            In (0, 1].

        Raises
        ------
        ValueError
            When the share is not in this range.
        """
        asked = in_interval("share", positive("share", share), 0, 1)
        return int(np.searchsorted(self.cumulative, asked)) + 1

    # --- errors -----------------------------------------------------------------------------------

    @property
    def batches(self) -> int:
        """Number of batches for the standard errors."""
        return len(self._averages.durations)

    @cached_property
    def change(self) -> RegimeChange | None:
        """The change of regime of the kept states; None where none is detected, and for samples.

        The standard errors cover the powers before and after. A transient longer than the run looks
        like sustained chaos: see `dynkit.analysis.regimes.regime_change`.
        """
        return self._change_of()

    @cached_property
    def _deviations(self) -> Array:
        """Contribution (b, N) of each batch to the deviations of the powers from their means."""
        squares = np.einsum("ij,bik,kj->bj", self.modes, self._products, self.modes, optimize=True)
        total = self._averages.durations.sum()
        return np.asarray((squares - self._averages.durations[:, None] * self.power) / total)

    @cached_property
    def standard_errors(self) -> Array:
        """One standard error of each power, (N,), as an average over an infinite motion.

        It covers about 68 %, and is not a bound, in contrast to `error`. Twice it is the half-width
        of a 95 % interval (Student's t) from the amplitudes of the slow waves in the batches: see
        `dynkit.analysis.averages`. The motion is divided into at most 32 batches of successive
        impacts or samples; with fewer than two the errors are infinite. They are too small where
        the motion lasts for few correlation times (of thirty of them, three errors are exceeded in
        5 % of cases, of three hundred in 1 %), or has not reached its attractor. They are too large
        for a periodic motion, where they depend on the ends of the batches within the period. Where
        the motion changes its regime (`change`) they cover the powers before and after.
        """
        return self._errors(self._deviations)

    @cached_property
    def cumulative_errors(self) -> Array:
        """One standard error, (N,), of each share in `cumulative`, in the same way."""
        running = np.cumsum(self._deviations, axis=1)
        shares = (running - self.cumulative * running[:, -1:]) / self.power.sum()
        return self._errors(shares)

    def _errors(self, deviations: Array) -> Array:
        durations = self._averages.durations
        return batch_errors(deviations, durations / durations.sum(), self.change)

    # --- normal modes -----------------------------------------------------------------------------

    def modal_assurance(self, modes: object = None) -> Array:
        """Return the modal assurance matrix, (N, m), of proper orthogonal modes and others.

        Entry (i, j) is the squared cosine of the angle between proper orthogonal mode i and mode j:
        1 when they are the same.

        Parameters
        ----------
        modes : (N, m) array_like, optional
            Modes, one in each column; by default the normal modes of the attractor's system.

        Raises
        ------
        ValueError
            When there are no modes, they have another shape, or one is zero.

        References
        ----------
        R. J. Allemang, The modal assurance criterion, Sound and Vibration 37 (2003) 14-23.
        """
        own = self._unit_columns(modes)
        return np.asarray((self.modes.T @ own) ** 2)

    def _unit_columns(self, modes: object) -> Array:
        if modes is None:
            modes = self._normal_modes
        if modes is None:
            raise ValueError("modes must be given: the source has no normal modes")
        array = finite_array("modes", modes, (len(self.mean), None))
        largest = abs(array).max(axis=0)
        for j in np.flatnonzero(largest == 0.0)[:1].tolist():
            raise ValueError(f"modes[:, {j}] must not be zero")
        array = array / largest  # squares would overflow, or vanish
        return np.asarray(array / np.linalg.norm(array, axis=0))

    # --- figures ----------------------------------------------------------------------------------

    def plot(
        self, ax: Axes | None = None, *, share: float = 0.99, label: str | None = None
    ) -> Axes:
        """Draw the cumulative power against the number of modes, and mark the rank at a share.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw into; by default those of a new figure of column width.
        share : float
            The share to mark.
        label : str, optional
            Text for a legend.

        Returns
        -------
        Axes
        """
        return draw_cumulative(self.cumulative, self.change, ax, self.rank(share), share, label)

    def plot_modes(
        self,
        ax: Sequence[Axes] | None = None,
        *,
        count: int | None = None,
        modes: object = None,
    ) -> list[Axes]:
        """Draw the first proper orthogonal modes, each with the most similar normal mode.

        Where there are no normal modes, as for samples, they are drawn alone.

        Parameters
        ----------
        ax : sequence of Axes, optional
            Axes for each mode; by default those of a new figure.
        count : int, optional
            Number of modes; by default four, or all if there are fewer.
        modes : (N, m) array_like, optional
            As for `modal_assurance`.

        Returns
        -------
        list of Axes
        """
        number = positive_integer("count", min(4, len(self.mean)) if count is None else count)
        if number > len(self.mean):
            raise ValueError(f"count must not exceed the {len(self.mean)} modes; got {number}")
        if ax is not None and len(ax) != number:
            raise ValueError(f"ax must hold {number} axes; got {len(ax)}")
        alone = modes is None and self._normal_modes is None
        others = None if alone else self._unit_columns(modes)
        return draw_modes(self.modes, ax, number, others)
