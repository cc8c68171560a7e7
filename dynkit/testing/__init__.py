"""Conformance checks of subclasses against the contracts of their base classes.

Each check is a function that asserts one property; its AssertionError names the property. For
pytest the checks are in tuples::

    @pytest.mark.parametrize("check", map_checks, ids=check_name)
    def test_my_map_conforms(check):
        check(MyMap(), states)

``check_map(MyMap(), states)`` runs all of them. The rows of `states` are about five states at which
the system is smooth. Derivatives are compared with differences within the estimated error of the
differences; states of flows, which may be integrated, within a relative 1e-7.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
