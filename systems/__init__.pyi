# Public names and the modules that define them, for type checkers and for lazy_loader.
from .flows.brusselator import Brusselator as Brusselator
from .flows.chua import Chua as Chua
from .flows.double_pendulum import DoublePendulum as DoublePendulum
from .flows.duffing import Duffing as Duffing
from .flows.henon_heiles import HenonHeiles as HenonHeiles
from .flows.integrated import IntegratedFlow as IntegratedFlow
from .flows.lorenz import Lorenz as Lorenz
from .flows.rossler import Rossler as Rossler
from .flows.van_der_pol import VanDerPol as VanDerPol
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
from .maps.ikeda import Ikeda as Ikeda
from .maps.logistic import DelayedLogistic as DelayedLogistic, Logistic as Logistic
from .maps.standard import StandardMap as StandardMap
from .maps.towel import FoldedTowel as FoldedTowel
from .structure.lagrangian import LagrangianStructure as LagrangianStructure
from .symbolic.flows import SymbolicFlow as SymbolicFlow
from .symbolic.maps import CompiledMap as CompiledMap, SymbolicMap as SymbolicMap
