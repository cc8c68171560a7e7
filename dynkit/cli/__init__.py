"""The `dynkit` command: a front end to toolkit, systems and analysis.

For instance:
  dynkit simulate --frequency 0.87
  dynkit sweep --from 0.70 --to 0.76 --step 0.002 --out diagram.png
  dynkit continue --frequency 0.87 --from 0.7 --to 1.1
  dynkit map --x frequency,0.2,1.8,60 --y damping,0.02,0.3,40 --out map.png
  dynkit view results.h5
  dynkit work-precision --frequency 0.87 --out error-time.png

dynkit COMMAND --help lists the options of a command.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from types import ModuleType
from typing import Any, NoReturn

_OK, _FAILED, _BAD_INPUT, _INTERRUPTED = 0, 1, 2, 130

COMMANDS = {
    "simulate": "one motion",
    "sweep": "a sweep of one parameter",
    "map": "a map of two parameters",
    "continue": "a branch of periodic orbits",
    "view": "a page for the browser, of a stored result",
    "work-precision": "error against run time of dynkit and of SciPy's integrators",
}
_FILES = ("simulate", "sweep", "map", "branch", "view", "work_precision")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the `dynkit` command.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments; by default those of this process.

    Returns
    -------
    int
        Exit code: 0 for success; 2 for bad input, with one line on stderr and no file written; 1
        for a failed run; 130 for an interrupted one.

    Examples
    --------
    >>> main(["simulate", "--frequency", "-1"])
    2
    """
    try:
        arguments, unknown = _parser().parse_known_args(argv)
    except SystemExit as ended:  # argparse has printed the reason
        return ended.code if isinstance(ended.code, int) else _FAILED
    return _run(arguments, unknown)


class _Parser(argparse.ArgumentParser):
    """A parser whose errors take one line and exit code 2.

    The options of a command are added when that command is parsed, so that the help of another
    command does not import its modules.
    """

    def __init__(self, command: str = "", **settings: Any) -> None:
        self._command = command
        settings["formatter_class"] = argparse.RawDescriptionHelpFormatter
        super().__init__(allow_abbrev=False, **settings)

    def error(self, message: str) -> NoReturn:
        self.exit(_BAD_INPUT, f"{self.prog}: error: {message}\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        if self._command:
            file = dict(zip(COMMANDS, _FILES, strict=True))[self._command]
            self._add_options(import_module(f"dynkit.cli.{file}"))
        return super().parse_known_args(args, namespace)

    def _add_options(self, module: ModuleType) -> None:
        from dynkit.cli.options import MACHINE, START

        self.description, mark, examples = (module.__doc__ or "").partition("For instance:")
        self.epilog = mark + examples
        self.set_defaults(run=module.run, options=module.OPTIONS)
        places = [option.metavar for option in module.OPTIONS if option.positional]
        self.usage = f"{self.prog} {' '.join(places) or '[FILE.toml]'} [options]"
        if not places:
            self.add_argument("file", metavar="FILE.toml", nargs="?", help="file of options")
            self.add_argument("--config", metavar="FILE.toml", help="another way to give it")
        titles = "the run and its output", "the machine", "its start"
        run, machine, start = [self.add_argument_group(title) for title in titles]
        for option in module.OPTIONS:
            if option.positional:
                self.add_argument(option.name, metavar=option.metavar, help=option.help)
                continue
            group = machine if option in MACHINE else start if option in START else run
            kind: dict[str, Any] = {"metavar": option.metavar}
            if not option.metavar:
                kind = {"action": argparse.BooleanOptionalAction}
            group.add_argument(f"--{option.name}", help=option.help, default=None, **kind)


def _parser() -> _Parser:
    from dynkit import __version__

    _, mark, examples = (__doc__ or "").partition("For instance:")
    about = "Dynamical systems with impacts."
    parser = _Parser(prog="dynkit", description=about, epilog=mark + examples)
    parser.add_argument("--version", action="version", version=f"dynkit {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, summary in COMMANDS.items():
        commands.add_parser(name, help=summary, command=name)
    return parser


def _run(arguments: argparse.Namespace, unknown: list[str]) -> int:
    from dynkit.cli.options import Asked
    from dynkit.core.no_motion import NoMotion
    from dynkit.engine import WorkerLost
    from dynkit.orbits.newton import NoConvergence

    command = f"dynkit {arguments.command}"
    if unknown:
        return _say(command, f"error: there is no argument {' '.join(unknown)}", _BAD_INPUT)
    try:
        file, config = (getattr(arguments, name, None) for name in ("file", "config"))
        if file and config:
            raise ValueError(f"config must not be given together with a file; got {config!r}")
        file = file or config
        arguments.run(Asked.of(arguments.options, file, vars(arguments)))
    except ValueError as refusal:
        return _say(command, f"error: {_with_notes(refusal)}", _BAD_INPUT)
    except KeyboardInterrupt:
        return _say(command, "interrupted", _INTERRUPTED)
    except (
        NoConvergence,
        NoMotion,
        NotImplementedError,
        OSError,
        MemoryError,
        WorkerLost,
    ) as failure:
        return _say(command, f"failed: {_with_notes(failure)}", _FAILED)
    return _OK


def _with_notes(failure: Exception) -> str:
    notes = [note for note in getattr(failure, "__notes__", []) if "\n" not in note]
    return ", ".join([str(failure) or type(failure).__name__, *notes])


def _say(command: str, message: str, code: int) -> int:
    line = " ".join(message.split())
    print(f"{command}: {line}", file=sys.stderr)
    return code
