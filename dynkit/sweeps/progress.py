"""The progress bar of a sweep: the current parameter, and the label where the kept states tell."""

import sys
import time
from types import TracebackType
from typing import Any, Self, final

from dynkit.labels import OrbitKind
from dynkit.sweeps.following import Plan, Point

# Labels cost more than what they label: only those that are seen are worked out.
_INTERVAL = 0.1


@final
class Progress:
    """A bar on standard error, or nothing."""

    def __init__(self, plan: Plan, finished: int, *, shown: bool) -> None:
        self._plan = plan
        self._bar: Any = None
        self._due = time.monotonic()
        if shown:
            from tqdm import tqdm

            self._bar = tqdm(
                total=len(plan.values), initial=finished, unit="value", file=sys.stderr
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.close()

    def reached(self, point: Point) -> None:
        """Show a point, now and then and at the end."""
        done = point.place + 1
        if self._bar is None or (time.monotonic() < self._due and done < len(self._plan.values)):
            return
        label = point.motion.label_within(self._plan.keep)
        told = "..." if label.kind is OrbitKind.UNSETTLED else str(label)
        value = float(self._plan.values[point.place])
        self._bar.n = done
        self._bar.set_postfix_str(f"{self._plan.parameter} {value:.6g}: {told}")
        self._due = time.monotonic() + _INTERVAL
