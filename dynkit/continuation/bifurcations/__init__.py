"""Bifurcations along a branch: found, located, classified, and left on other branches."""
