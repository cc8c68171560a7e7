"""One stop of an impact oscillator: its gap in flight, and the motion in contact with it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, TypeAlias, final

from flint import arb, arb_mat

from tests.reference.linear_motion import LinearMotion, Row

if TYPE_CHECKING:
    from tests.reference.general_oscillator import GeneralOscillator

Side: TypeAlias = Literal["near", "far"]


@final
class Stop:
    """Contact is the motion without coordinate c, which follows the stop; its force is a row."""

    def __init__(self, owner: GeneralOscillator, side: Side, offset: arb) -> None:
        self.name, self.owner, self.offset = side, owner, offset
        self.sign = owner.sign if side == "near" else -owner.sign
        n, c, a, w = owner.size, owner.contact, owner.amplitude, owner.frequency
        gap = arb_mat(1, 2 * n + 3)
        gap[0, c], gap[0, 2 * n], gap[0, 2 * n + 2] = self.sign, -self.sign * a, -self.sign * offset
        self.gap = Row(owner.flight, gap)
        # Displacement, velocity and acceleration of the stop on sine, cosine and 1.
        self.follow = (
            arb_mat([[a, arb(0), offset]]),
            arb_mat([[arb(0), a * w, arb(0)]]),
            arb_mat([[-a * w * w, arb(0), arb(0)]]),
        )
        others = [i for i in range(n) if i != c]
        mass, damping, stiffness = owner.mass, owner.damping, owner.stiffness
        displacement, velocity, acceleration = self.follow

        def carried(i: int) -> arb_mat:
            """Force on coordinate i that the motion of coordinate c asks for, and the outer one."""
            outer = arb_mat([[owner.forcing[i, j] for j in range(3)]])
            inner = mass[i, c] * acceleration + damping[i, c] * velocity
            return outer - inner - stiffness[i, c] * displacement

        m = n - 1
        forcing = arb_mat(m, 3, [x for i in others for x in carried(i).entries()])
        parts = [_without(part, others) for part in (mass, damping, stiffness)]
        self.held = LinearMotion(parts[0], parts[1], parts[2], forcing, w)
        # sign * force = M_ci y_i'' + C_ci y_i' + K_ci y_i - what coordinate c is given.
        push = arb_mat(1, 2 * m + 3)
        own = carried(c).entries()
        for j in range(3):
            push[0, 2 * m + j] = -self.sign * own[j]
        for k, i in enumerate(others):
            push[0, k] += self.sign * stiffness[c, i]
            push[0, m + k] += self.sign * damping[c, i]
            for j in range(2 * m + 3):
                push[0, j] += self.sign * mass[c, i] * self.held.matrix[m + k, j]
        self.force = Row(self.held, push.mid())

    def hold(self, z: arb_mat) -> arb_mat:
        """State of the contact from one of the flight."""
        n, c = self.owner.size, self.owner.contact
        return arb_mat([[x] for i, x in enumerate(z.entries()) if i not in (c, n + c)])

    def let_go(self, z: arb_mat) -> arb_mat:
        """State of the flight from one of the contact."""
        m, c = self.owner.size - 1, self.owner.contact
        entries = z.entries()
        turn = arb_mat([[x] for x in entries[2 * m :]])
        x, v = entries[:m], entries[m : 2 * m]
        x.insert(c, (self.follow[0] * turn)[0, 0])
        v.insert(c, (self.follow[1] * turn)[0, 0])
        return arb_mat([[y] for y in x + v + entries[2 * m :]]).mid()


def _without(part: arb_mat, others: Sequence[int]) -> arb_mat:
    return arb_mat(len(others), len(others), [part[i, j] for i in others for j in others])
