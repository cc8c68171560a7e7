"""Where the checks are run."""

import numpy as np

from dynkit.dynamics.section import Hyperplane

STATES = np.array([[0.3, 0.1], [-0.7, 0.2], [1.1, -0.3]])
STATES_3D = np.array([[0.9, 0.2, 0.5], [-0.3, 1.4, -0.2]])
PLANE = Hyperplane(np.array([0.3, 1.0, 0.2]), 0.1)
POINTS = np.array([[0.9, 0.4], [1.3, -0.2]])
