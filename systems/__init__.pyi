# Public names and the modules that define them, for type checkers and for lazy_loader.
from .flows.duffing import Duffing as Duffing
from .flows.integrated import IntegratedFlow as IntegratedFlow
from .flows.lorenz import Lorenz as Lorenz
from .flows.rossler import Rossler as Rossler
from .impact.ball import BouncingBall as BouncingBall
from .impact.chain import ImpactChain as ImpactChain
from .impact.matrices import MatrixOscillator as MatrixOscillator
from .impact.oscillator import ImpactOscillator as ImpactOscillator
from .impact.play import PlayOscillator as PlayOscillator
from .impact.single import SingleImpactOscillator as SingleImpactOscillator
from .maps.henon import Henon as Henon
from .maps.high_bounce import HighBounce as HighBounce
from .maps.logistic import Logistic as Logistic
from .structure.lagrangian import LagrangianStructure as LagrangianStructure
