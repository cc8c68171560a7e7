"""Maps, flows, Poincare sections and attractors: the abstract classes that systems implement."""
