"""A toolkit for dynamical systems with impacts.

`dynkit.systems` has the systems, and `dynkit.analysis` has measures and figures of their motions.
Every name is imported when it is first used, so that ``import dynkit`` is fast.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
