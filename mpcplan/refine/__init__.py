"""Refinement of a seed by optimal control of the kinematic single-track model."""
