"""Periodic orbits of impact oscillators: P(n,m), and P(inf,m) with sticking."""
