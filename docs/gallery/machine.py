"""A machine as it is defined.

Four masses: a shaking table below the last one, two masses that hit each other, a soft stop, and
a belt that rubs on the first mass.
"""

from dynkit.systems import DryFriction, HardStop, ImpactChain, SoftStop

machine = ImpactChain(
    masses=4,
    frequency=0.9,
    elements=[
        HardStop(3, amplitude=0.1, restitution=0.85, name="table"),
        HardStop((1, 2), offset=-0.2, restitution=0.5, name="clash"),
        SoftStop(1, offset=-0.3, stiffness=50.0, damping=0.2, name="pad"),
        DryFriction(0, force=0.02, static=0.03, velocity=0.1, name="belt"),
    ],
)
machine.plot()
