"""Verdict and cost of a solution, as the official drivability checker sees it."""
