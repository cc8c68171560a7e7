"""The arguments of the `dynkit` command, and its help."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import NoReturn

from dynkit._version import __version__
from dynkit.cli.options import CONTINUE, MAP, SIMULATE, SWEEP, Option

_COMMANDS = """\
examples:
  dynkit simulate --frequency 0.87
  dynkit sweep --from 0.70 --to 0.76 --step 0.002 --out diagram.png
  dynkit continue --frequency 0.87 --from 0.7 --to 1.1
  dynkit map --x frequency,0.2,1.8,60 --y damping,0.02,0.3,40 --out map.png

dynkit COMMAND --help tells more about each.
"""

_SIMULATE = """\
One motion of a chain of masses whose last one hits a vibrating table: its label, and its impacts.

Options may also stand in a TOML file, under the same names; what is given on the command line goes
before what stands there. Several numbers are separated by commas; --position=-0.1,0.5 needs the
equals sign because of the minus.
"""

_SIMULATE_EXAMPLES = """\
examples:
  dynkit simulate --frequency 0.87
  dynkit simulate --frequency 1.346 --transient 0 --impacts 2000 --out chaos.csv
  dynkit simulate --masses 1,1,2 --frequency 0.9 --observable time,position --out motion.npz
  dynkit simulate motion.toml --restitution 0.7 --out section.png

motion.toml may hold:
  masses = 10
  damping = 0.1
  frequency = 0.87
  impacts = 200
"""

_SWEEP = """\
A sweep of one parameter: each value starts from the last state of the value before.

Options may also stand in a TOML file, under the same names; what is given on the command line goes
before what stands there. With --store every finished chunk is kept, and the same command resumes.
"""

_SWEEP_EXAMPLES = """\
examples:
  dynkit sweep --from 0.86 --to 0.88 --step 0.01 --out diagram.png
  dynkit sweep --parameter restitution --values 0.7,0.8,0.9 --frequency 0.87 --out sweep.csv
  dynkit sweep --from 0.28 --to 0.27 --step -0.002 --observable energy --store sweep.h5
  dynkit sweep sweep.toml --keep 50 --out sweep.npz

sweep.toml may hold:
  damping = 0.1
  parameter = "frequency"
  from = 0.86
  to = 0.88
  step = 0.01
"""

_MAP = """\
A map of two parameters: what motion there is at each pair of values, all from the same start.

Options may also stand in a TOML file, under the same names; what is given on the command line goes
before what stands there. With --store every finished chunk is kept, and the same command resumes,
also with another number of --workers: the result is the same bits.
"""

_MAP_EXAMPLES = """\
examples:
  dynkit map --x frequency,0.2,1.8,60 --y damping,0.02,0.3,40 --workers 2 --out map.png
  dynkit map --frequency 0.87 --x restitution,0.5,0.9,20 --y offset,-0.1,0.1,20 --out map.csv
  dynkit map map.toml --store map.h5 --out map.svg

map.toml may hold:
  x = ["frequency", 0.2, 1.8, 200]
  y = ["damping", 0.02, 0.3, 200]
  transient = 900
  workers = 8
"""

_CONTINUE = """\
The branch of a periodic orbit as one parameter changes, stable or not, and its bifurcations: folds
(SN), period doublings (PD), tori (NS), branch points (BP), grazing (GR), borders of chatter (CB).
It goes through folds, and on where the orbits are no motions any more (inadmissible).

Options may also stand in a TOML file, under the same names; what is given on the command line goes
before what stands there. The branch starts at the value of the parameter that is given for the
chain, and stays between --from and --to.
"""

_CONTINUE_EXAMPLES = """\
examples:
  dynkit continue --frequency 0.87 --from 0.7 --to 1.1
  dynkit continue --frequency 0.8 --impacts 2 --periods 3 --from 0.75 --to 0.83 --out branch.png
  dynkit continue --frequency 0.87 --parameter amplitude --from 0.05 --to 0.2 --store branch.h5
  dynkit continue branch.toml --out branch.svg

branch.toml may hold:
  damping = 0.1
  frequency = 0.87
  periods = 3
  parameter = "restitution"
  from = 0.5
  to = 0.95
"""


class _Parser(argparse.ArgumentParser):
    """Refusals take one line, and exit code 2."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message}\n")


def make_parser() -> argparse.ArgumentParser:
    """Return the parser; the arguments that it parses hold ``command`` and ``run``."""
    parser = _Parser(
        prog="dynkit",
        description="Dynamical systems with impacts.",
        epilog=_COMMANDS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"dynkit {__version__}")
    commands = parser.add_subparsers(
        dest="command", metavar="COMMAND", required=True, parser_class=_Parser
    )
    simulate = commands.add_parser("simulate", help="one motion")
    _command(simulate, _SIMULATE, _SIMULATE_EXAMPLES, _run_simulate)
    _add_options(simulate, SIMULATE)
    sweep = commands.add_parser("sweep", help="a sweep of one parameter")
    _command(sweep, _SWEEP, _SWEEP_EXAMPLES, _run_sweep)
    _add_options(sweep, SWEEP)
    two = commands.add_parser("map", help="a map of two parameters")
    _command(two, _MAP, _MAP_EXAMPLES, _run_map)
    _add_options(two, MAP)
    branch = commands.add_parser("continue", help="a branch of periodic orbits")
    _command(branch, _CONTINUE, _CONTINUE_EXAMPLES, _run_continue)
    _add_options(branch, CONTINUE)
    return parser


def _command(
    parser: argparse.ArgumentParser,
    description: str,
    examples: str,
    run: Callable[[argparse.Namespace], None],
) -> None:
    parser.description = description
    parser.epilog = examples
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.allow_abbrev = False
    parser.set_defaults(run=run)


def _add_options(parser: argparse.ArgumentParser, options: tuple[Option, ...]) -> None:
    parser.add_argument("file", metavar="FILE.toml", nargs="?", help="file of options")
    for option in options:
        if option.kind == "switch":
            parser.add_argument(
                f"--{option.name}",
                action=argparse.BooleanOptionalAction,
                default=None,
                help=option.help,
            )
        else:
            parser.add_argument(f"--{option.name}", metavar=option.metavar, help=option.help)


def _run_simulate(arguments: argparse.Namespace) -> None:
    from dynkit.cli.options import gather
    from dynkit.cli.simulate import simulate

    simulate(gather(SIMULATE, arguments.file, vars(arguments)))


def _run_sweep(arguments: argparse.Namespace) -> None:
    from dynkit.cli.options import gather
    from dynkit.cli.sweep import sweep

    sweep(gather(SWEEP, arguments.file, vars(arguments)))


def _run_map(arguments: argparse.Namespace) -> None:
    from dynkit.cli.map import parameter_map
    from dynkit.cli.options import gather

    parameter_map(gather(MAP, arguments.file, vars(arguments)))


def _run_continue(arguments: argparse.Namespace) -> None:
    from dynkit.cli.branch import continue_branch
    from dynkit.cli.options import gather

    continue_branch(gather(CONTINUE, arguments.file, vars(arguments)))
