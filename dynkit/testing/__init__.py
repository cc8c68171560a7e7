"""Conformance checks: whether a subclass keeps the contract of its base class.

Each check is a function that asserts one property and raises AssertionError, which names it. They
stand in tuples, for pytest::

    @pytest.mark.parametrize("check", map_checks, ids=check_name)
    def test_my_map_conforms(check):
        check(MyMap(), states)

or run at once: ``check_map(MyMap(), states)``. States are the rows of an array, some five of them,
where the system is smooth. Derivatives are compared with differences, within the error that these
estimate of themselves; states of flows, which may be integrated, within 1e-7, relative.
"""

from dynkit.core.differences import numerical_derivative
from dynkit.testing.attractors import (
    AttractorCheck,
    MakeAttractor,
    attractor_checks,
    attractor_has_sections,
    attractor_is_deterministic,
    attractor_says_cost_and_error,
    attractor_states_have_the_shape,
    check_attractor,
    time_series_does_not_depend_on_company,
    transient_skips_states,
)
from dynkit.testing.flows import (
    FlowCheck,
    advance_composes,
    check_flow,
    flow_checks,
    flow_derivative_is_the_derivative,
    flow_is_pure,
    flow_parameter_derivatives_are_right,
    flow_refuses_bad_states,
    flow_results_have_the_shape,
    velocity_is_the_rate_of_advance,
)
from dynkit.testing.maps import (
    MapCheck,
    check_map,
    difference_is_antisymmetric,
    iterate_repeats_the_call,
    jacobian_has_the_shape,
    jacobian_is_the_derivative,
    jacobian_is_the_product_of_its_factors,
    map_checks,
    map_is_pure,
    map_refuses_bad_states,
    next_state_has_the_shape,
    parameter_derivatives_are_right,
    replace_changes_what_is_named,
)
from dynkit.testing.poincare_maps import (
    PoincareMapCheck,
    check_poincare_map,
    crossing_goes_in_the_direction,
    crossing_is_the_first,
    crossing_is_where_the_flow_is,
    crossing_lands_on_the_section,
    poincare_map_checks,
    time_limit_is_kept,
)
from dynkit.testing.requirements import VectorFunction, check_name
from dynkit.testing.sections import (
    SectionCheck,
    check_section,
    lift_lands_on_the_section,
    reduce_inverts_lift,
    section_checks,
    section_derivatives_are_right,
    section_has_dimension_and_direction,
    section_is_pure,
    section_refuses_bad_states,
)

__all__ = [
    "AttractorCheck",
    "FlowCheck",
    "MakeAttractor",
    "MapCheck",
    "PoincareMapCheck",
    "SectionCheck",
    "VectorFunction",
    "advance_composes",
    "attractor_checks",
    "attractor_has_sections",
    "attractor_is_deterministic",
    "attractor_says_cost_and_error",
    "attractor_states_have_the_shape",
    "check_attractor",
    "check_flow",
    "check_map",
    "check_name",
    "check_poincare_map",
    "check_section",
    "crossing_goes_in_the_direction",
    "crossing_is_the_first",
    "crossing_is_where_the_flow_is",
    "crossing_lands_on_the_section",
    "difference_is_antisymmetric",
    "flow_checks",
    "flow_derivative_is_the_derivative",
    "flow_is_pure",
    "flow_parameter_derivatives_are_right",
    "flow_refuses_bad_states",
    "flow_results_have_the_shape",
    "iterate_repeats_the_call",
    "jacobian_has_the_shape",
    "jacobian_is_the_derivative",
    "jacobian_is_the_product_of_its_factors",
    "lift_lands_on_the_section",
    "map_checks",
    "map_is_pure",
    "map_refuses_bad_states",
    "next_state_has_the_shape",
    "numerical_derivative",
    "parameter_derivatives_are_right",
    "poincare_map_checks",
    "reduce_inverts_lift",
    "replace_changes_what_is_named",
    "section_checks",
    "section_derivatives_are_right",
    "section_has_dimension_and_direction",
    "section_is_pure",
    "section_refuses_bad_states",
    "time_limit_is_kept",
    "time_series_does_not_depend_on_company",
    "transient_skips_states",
    "velocity_is_the_rate_of_advance",
]
