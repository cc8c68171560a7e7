"""Chatter of a ball on a table: flight times that shrink by a factor."""

import numpy as np
from matplotlib import pyplot as plt

from dynkit.plotting.figures import print_style
from dynkit.systems import BouncingBall

ball = BouncingBall(amplitude=0.16, frequency=3.0, restitution=0.5)
record = ball.simulate(impacts=60)
end = record.sticking[0, 0]
before = record.time[record.time < end]
with print_style():
    figure = plt.figure(figsize=(6.8, 2.3), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(2, 1))
    record.plot(left, begin=4.0, end=9.0)
    flights = np.diff(before)[-15:]
    right.semilogy(range(1, 16), flights, "ko", ms=3, label="flight times")
    right.semilogy(range(1, 16), flights[0] * 0.5 ** np.arange(15), "0.6", lw=0.7, label="$r^n$")
    right.set(xlabel="bounce $n$", ylabel="flight time")
    right.legend()
