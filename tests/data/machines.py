"""A machine whose motions enter several modes."""

from dynkit.systems import DryFriction, HardStop, ImpactChain, SoftStop


def machine() -> ImpactChain:
    """Three masses with two stops, a pad and friction."""
    rough = [
        HardStop(2, amplitude=0.1, restitution=0.85, name="table"),
        HardStop((0, 1), offset=-0.2, restitution=0.5),
        SoftStop(1, offset=-0.3, stiffness=50.0, damping=0.2),
        DryFriction(0, force=0.02, static=0.03, velocity=0.1, name="belt"),
    ]
    return ImpactChain(masses=3, frequency=0.9, elements=rough)


def entered() -> ImpactChain:
    """The same machine after a motion that enters its modes in another order."""
    made = machine()
    made.simulate(impacts=5, start=made.state([0.0, 0.0, 1.0], [2.0, -3.0, -1.0]))
    return made
