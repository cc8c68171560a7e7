"""Bifurcations along a branch: detection, location, criticality, and switching of branches."""
