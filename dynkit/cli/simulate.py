"""A motion of masses in a chain, the last of which hits a vibrating table.

It prints the label of the motion, and writes its impacts. --store keeps the
motion for `dynkit view` and for dynkit.systems.ImpactAttractor.load.

Options may also be in a TOML file, under the same names; the command line
overrides the file. Several numbers are separated by commas;
--position=-0.1,0.5 needs the equals sign because of the minus.

For instance:
  dynkit simulate --frequency 0.87
  dynkit simulate --frequency 1.346 --transient 0 --impacts 2000 --out chaos.csv
  dynkit simulate --masses 1,1,2 --frequency 0.9 --observable time,position --out motion.npz
  dynkit simulate motion.toml --restitution 0.7 --out section.png

motion.toml may hold:
  masses = 10
  damping = 0.1
  frequency = 0.87
  impacts = 200
and, in place of the table, elements of kind HardStop, SoftStop, DryFriction or Jenkins:
  [[elements]]
  kind = "HardStop"
  coordinate = 9
  restitution = 0.7
or an impact law: restitution = { kind = "PlasticBelow", velocity = 0.05 }, ViscoelasticSpheres.
"""

from __future__ import annotations

from functools import partial

from dynkit.cli.options import OBSERVABLE, SYSTEM, Asked, Option, options_of
from dynkit.cli.output import OUT, files_of, plotted, print_summary, write
from dynkit.core.reprs import span
from dynkit.data.dataset import Dataset
from dynkit.systems.impact.oscillators.oscillator import ImpactOscillator

_SCALARS = ("time", "phase", "relative_velocity", "energy")

RUN = options_of(ImpactOscillator.attractor, "transient", "impacts")
STORE = Option("store", "FILE.h5", "file for the motion; dynkit view shows it")
OPTIONS = (*SYSTEM, *RUN, OBSERVABLE, STORE, OUT)


def run(asked: Asked) -> None:
    """Simulate, write files, and print a summary.

    Raises
    ------
    ValueError
        When an option is refused; no file has been written then.
    """
    names = asked.names("observable", _SCALARS, (*_SCALARS, "position", "velocity"))
    store, file = files_of(asked)
    chain = asked.chain()
    found = chain.attractor(start=asked.start(chain), **asked.only("transient", "impacts"))
    record = found.record
    if store:
        found.save(store)
    if file:
        data = record.dataset()
        kept = {
            name: data.variables[name]
            for name in data.variables
            if name in names or name.startswith("contact")
        }
        facts = {**data.attributes, "transient": float(found.transient)}
        chosen = Dataset(data.coordinates, kept, facts)
        write(file, partial(plotted, found), chosen)
    states = "periods" if chain._strobed else "impacts"
    shown = {
        "label": f"{found.label} (from {found.label.simulated} {states})",
        states: f"{len(record)} after {found.transient} that were skipped",
        "ending": record.ending.value,
        "contacts": f"{len(record.sticking)} intervals of sticking",
        "relative velocity": span(record.relative_velocity),
        "energy": span(record.energy),
        "error": f"{found.error:.1e} (estimate of the largest in a state kept)",
        "seconds": f"{found.cost.seconds:.3f}",
    }
    print_summary(shown, store, file)
