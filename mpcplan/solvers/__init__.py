"""Solvers of the refinement's problem compared on the problems of real runs."""
