"""What is to be said of the table of error against run time."""

NOTES = """\
The error is the largest of any impact: of its time over the table's period, of a position over the
largest, of a velocity over the largest; of a release, its time. A dash stands where impacts are
missed or invented, or the run was given up. Seconds are those of the processor, the least of some
repetitions, without preparation (compilation, modes). dynkit, paper, Moreau and heyoka are
compiled; solve_ivp is bound by Python, some 10 to 30 microseconds for an evaluation: compare its
evaluations with the work of others too. In a run of few impacts most of dynkit's time is the start
of the run. A tolerance is what the method takes it for: paper, that of impact times; RK45, DOP853,
Radau, LSODA and heyoka, the relative one; Moreau and Siconos, the step over the table's period.
"""
