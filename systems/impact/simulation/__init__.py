"""The loop over flights and events: states, kernels, trajectories."""
