"""The verdict on a solution: six checks by name, why they failed, and the TR1 cost."""

from dataclasses import dataclass

from mpcplan.score.tr1 import CHECKER_WEIGHTS, PARTS, REPORT_WEIGHTS, tr1

CHECKS = ("all_problems", "goal", "start", "no_collision", "on_road", "feasible")
"""The official checks, in the order in which they run."""


@dataclass(frozen=True)
class Verdict:
    """What the official checker says of one solution.

    Attributes:
        scenario: id of the scenario.
        checks: passed or not, for each of :data:`CHECKS`.
        reasons: for every failed check, where and by how much it failed.
        valid: all checks passed.
        parts: unweighted Jlon, SR, D, LC, summed over the problems; None without a cost.
        tr1: total under the checker's weights.
        tr1_report: total under the competition report's weights.
        cost_error: why there is no cost, else ''.
        duration_s: driven time, summed over the problems [s].
    """

    scenario: str
    checks: dict[str, bool]
    reasons: dict[str, str]
    valid: bool
    parts: dict[str, float] | None
    tr1: float | None
    tr1_report: float | None
    cost_error: str
    duration_s: float

    @property
    def cause(self) -> str:
        """The first failed check and its reason, '' when valid."""
        return next((f"{n}: {self.reasons[n]}" for n in CHECKS if not self.checks[n]), "")


def verdict_lines(verdict: Verdict) -> list[str]:
    """The verdict in lines for people: failed checks with their place, then the cost."""
    lines = [f"{'failed':<10}{n}: {verdict.reasons[n]}" for n in CHECKS if not verdict.checks[n]]
    return lines + cost_lines(verdict)


def cost_lines(verdict: Verdict) -> list[str]:
    """TR1 with its four parts under both weightings, or why there is none."""
    if verdict.parts is None:
        return [f"{'TR1':<10}no cost: {verdict.cost_error}"]
    lines = []
    for name, weights in (("checker", CHECKER_WEIGHTS), ("report", REPORT_WEIGHTS)):
        parts = ", ".join(f"{part} {weights[part] * verdict.parts[part]:.4f}" for part in PARTS)
        total = tr1(verdict.parts, weights)
        lines.append(f"{'TR1':<10}{total:.4f} under the {name}'s weights ({parts})")
    return lines
