"""Names of the methods that come with dynkit."""

NAMES = ("dynkit", "paper", "RK45", "DOP853", "Radau", "LSODA", "Moreau", "heyoka", "Siconos")
"""dynkit's own maps, then its peers."""
