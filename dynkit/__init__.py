"""A toolkit for dynamical systems with impacts.

What is simulated stands in `dynkit.systems`, what is measured in `dynkit.analysis`. Every name here
is imported when it is first used, so that ``import dynkit`` stays light.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
