"""Slow, obvious, independent references that the tests compare the toolkit with.

Nothing here imports dynkit. ``oscillators`` and ``first_root`` work in interval arithmetic (every
answer is proved), ``verify`` checks very many claimed roots at once, ``impact_chain`` simulates the
chain of Cusumano & Bai (1993) to 50 digits, ``uniform_chain`` a long one, ``general_oscillator``
any impact oscillator (with ``stops``, ``linear_motion``, ``mode_bounds`` and ``general_roots``;
``extremes`` has cases for it), and ``brute_force`` steps the chain with a fixed small step.
``extreme_values`` and ``work_precision_jobs`` write the exact impacts of the benchmarks.
"""
