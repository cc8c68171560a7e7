# Public names and the modules that define them, for type checkers and for lazy_loader.
from .flows.duffing import Duffing as Duffing
from .flows.integrated import IntegratedFlow as IntegratedFlow
from .flows.lorenz import Lorenz as Lorenz
from .flows.rossler import Rossler as Rossler
from .impact.attractor import ImpactAttractor as ImpactAttractor
from .impact.ball import BouncingBall as BouncingBall
from .impact.chain import ImpactChain as ImpactChain
from .impact.elements import (
    Element as Element,
    HardStop as HardStop,
    Regime as Regime,
    SoftStop as SoftStop,
    Watch as Watch,
)
from .impact.friction import DryFriction as DryFriction
from .impact.matrices import MatrixOscillator as MatrixOscillator
from .impact.orbits.orbit import ImpactOrbit as ImpactOrbit
from .impact.oscillator import ImpactOscillator as ImpactOscillator
from .impact.play import PlayOscillator as PlayOscillator
from .impact.record import ImpactRecord as ImpactRecord
from .impact.single import SingleImpactOscillator as SingleImpactOscillator
from .impact.state import ImpactState as ImpactState
from .maps.henon import Henon as Henon
from .maps.high_bounce import HighBounce as HighBounce
from .maps.logistic import Logistic as Logistic
from .structure.lagrangian import LagrangianStructure as LagrangianStructure
