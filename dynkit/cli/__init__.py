"""The `dynkit` command: the one place that knows toolkit, systems and analysis."""

from __future__ import annotations

import sys
from collections.abc import Sequence

_OK, _FAILED, _BAD_INPUT, _INTERRUPTED = 0, 1, 2, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run the `dynkit` command.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments; by default those of this process.

    Returns
    -------
    int
        Exit code: 0 when all went well; 2 for bad input, with one line on stderr and nothing
        written; 1 when a run failed; 130 when it was interrupted.

    Examples
    --------
    >>> main(["simulate", "--frequency", "-1"])
    2
    """
    from dynkit.cli.arguments import make_parser
    from dynkit.core.no_motion import NoMotion
    from dynkit.engine import WorkerLost
    from dynkit.orbits.newton import NoConvergence

    try:
        arguments, unknown = make_parser().parse_known_args(argv)
    except SystemExit as ended:  # argparse has said why
        return ended.code if isinstance(ended.code, int) else _FAILED
    command = f"dynkit {arguments.command}"
    if unknown:
        return _say(command, f"error: there is no argument {' '.join(unknown)}", _BAD_INPUT)
    try:
        arguments.run(arguments)
    except ValueError as refusal:
        return _say(command, f"error: {_with_notes(refusal)}", _BAD_INPUT)
    except KeyboardInterrupt:
        return _say(command, "interrupted", _INTERRUPTED)
    except (NoConvergence, NoMotion, OSError, MemoryError, WorkerLost) as failure:
        return _say(command, f"failed: {_with_notes(failure)}", _FAILED)
    return _OK


def _with_notes(failure: Exception) -> str:
    notes = [note for note in getattr(failure, "__notes__", []) if "\n" not in note]
    return ", ".join([str(failure) or type(failure).__name__, *notes])


def _say(command: str, message: str, code: int) -> int:
    line = " ".join(message.split())
    print(f"{command}: {line}", file=sys.stderr)
    return code
