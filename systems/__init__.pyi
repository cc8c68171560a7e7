# Public names and the modules that define them, for type checkers and for lazy_loader.
from .flows.brusselator import Brusselator as Brusselator
from .flows.chua import Chua as Chua
from .flows.double_pendulum import DoublePendulum as DoublePendulum
from .flows.duffing import Duffing as Duffing
from .flows.henon_heiles import HenonHeiles as HenonHeiles
from .flows.integrated import IntegratedFlow as IntegratedFlow
from .flows.lorenz import Lorenz as Lorenz
from .flows.parametric_pendulum import ParametricPendulum as ParametricPendulum
from .flows.rossler import Rossler as Rossler
from .flows.three_body import RestrictedThreeBody as RestrictedThreeBody
from .flows.van_der_pol import VanDerPol as VanDerPol
from .flows.walkers import CompassGait as CompassGait, SimplestWalker as SimplestWalker
from .impact.elements.element import Element as Element, Regime as Regime, Watch as Watch
from .impact.elements.friction import DryFriction as DryFriction
from .impact.elements.jenkins import Jenkins as Jenkins, iwan as iwan
from .impact.elements.laws import (
    ImpactLaw as ImpactLaw,
    PlasticBelow as PlasticBelow,
    ViscoelasticSpheres as ViscoelasticSpheres,
)
from .impact.elements.stops import HardStop as HardStop, SoftStop as SoftStop
from .impact.orbits.orbit import ImpactOrbit as ImpactOrbit
from .impact.oscillators.attractor import ImpactAttractor as ImpactAttractor
from .impact.oscillators.ball import BouncingBall as BouncingBall
from .impact.oscillators.chain import ImpactChain as ImpactChain
from .impact.oscillators.matrix import MatrixOscillator as MatrixOscillator
from .impact.oscillators.nonlinear_chains import FPUTChain as FPUTChain, TodaChain as TodaChain
from .impact.oscillators.nonlinear_single import (
    ImpactDuffing as ImpactDuffing,
    ImpactPendulum as ImpactPendulum,
)
from .impact.oscillators.oscillator import ImpactOscillator as ImpactOscillator
from .impact.oscillators.play import PlayOscillator as PlayOscillator
from .impact.oscillators.rod import ImpactRod as ImpactRod
from .impact.oscillators.single import SingleImpactOscillator as SingleImpactOscillator
from .impact.records.record import ImpactRecord as ImpactRecord
from .impact.simulation.state import ImpactState as ImpactState
from .maps.henon import Henon as Henon
from .maps.high_bounce import HighBounce as HighBounce
from .maps.ikeda import Ikeda as Ikeda
from .maps.logistic import DelayedLogistic as DelayedLogistic, Logistic as Logistic
from .maps.standard import StandardMap as StandardMap
from .maps.towel import FoldedTowel as FoldedTowel
from .structure.chain import extensions as extensions
from .structure.lagrangian import LagrangianStructure as LagrangianStructure
from .symbolic.flows import SymbolicFlow as SymbolicFlow, SymbolicHybridFlow as SymbolicHybridFlow
from .symbolic.maps import CompiledMap as CompiledMap, SymbolicMap as SymbolicMap
