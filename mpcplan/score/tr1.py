"""The TR1 cost: J = w_Jlon Jlon + w_SR SR + w_D D + w_LC LC.

Jlon is the integral of the squared longitudinal jerk [m^2/s^5], SR of the squared steering rate
[rad^2/s], D of the closeness to the nearest obstacle ahead, exp(-0.2 d) [s], LC of the squared
offset from the lane's centre [m^2 s].
"""

from collections.abc import Mapping

PARTS = ("Jlon", "SR", "D", "LC")

CHECKER_WEIGHTS: Mapping[str, float] = {"Jlon": 0.01, "SR": 22.0, "D": 8.0, "LC": 0.5}
"""Weights of the drivability checker; results are ranked by these."""

REPORT_WEIGHTS: Mapping[str, float] = {**CHECKER_WEIGHTS, "LC": 5.0}
"""Weights of the 2024 competition report, whose lane offset counts ten times as much."""


def tr1(parts: Mapping[str, float], weights: Mapping[str, float] = CHECKER_WEIGHTS) -> float:
    """Weighted sum of the four partial costs; raises KeyError when one of them is missing."""
    return sum(weights[name] * parts[name] for name in PARTS)
