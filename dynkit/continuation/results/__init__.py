"""Branches, how they are drawn, and whether an orbit lies on one."""
