"""Why a run failed, in one sentence: the scenario, a constraint, or the planner.

The scenario is at fault where nobody could have solved it. A constraint is, where no plan reached
the goal from the first cycle on: then it names what refused the candidates. Else the planner is:
its plans reached the goal, until at some cycle none did any more, and none did again. Of a drive
that ended in a collision the same is asked of safe plans instead of those to the goal.
"""

from collections.abc import Callable, Sequence
from typing import Any

from mpcplan.explain.feared import COLLISION, refused_plans

Cycle = dict[str, Any]
TOLD = 2  # constraints
NO_SOLUTION = "the scenario has no solution: "


def fault_line(drive: dict[str, Any], scenario: str = "") -> str | None:
    """The sentence for a drive that failed; None for one that reached its goal.

    Args:
        drive: of the trace.
        scenario: why nobody can solve the scenario, '' where that is not known.
    """
    if drive.get("reached_step") is not None:
        return None
    if scenario:
        return f"fault     the scenario: {scenario.removeprefix(NO_SOLUTION)}"
    cycles = drive["cycles"]
    if not cycles:
        return f"fault     the scenario: nothing could be planned: {drive.get('cause', '')}"
    if drive.get("collided"):
        return f"fault     {_collision(cycles, str(drive.get('cause', '')))}"
    lost = _since(cycles, lambda cycle: not cycle["chosen"]["reaches_goal"])
    if lost is None:
        return (
            "fault     the planner: every plan reached the goal, and yet it was not reached: "
            f"{drive.get('cause', '')}"
        )
    why = _why(cycles[lost])
    if lost == 0:
        return f"fault     a constraint: no plan reached the goal from the first cycle on: {why}"
    before, now = cycles[lost - 1]["step"], cycles[lost]["step"]
    return (
        f"fault     the planner: its plan of step {before} still reached the goal, from step {now} "
        f"on none did any more: {why}"
    )


def _collision(cycles: Sequence[Cycle], cause: str) -> str:
    """Whose fault a collision was."""
    end = cause.partition(";")[0] or "it collided"
    lost = _since(cycles, lambda cycle: bool(cycle.get("fallback")))
    if lost is None:
        return (
            f"the planner: its plan of step {cycles[-1]['step']} was taken to be safe, and yet "
            f"{end}: somebody did not drive as predicted"
        )
    plans = refused_plans(cycles[lost])
    why = f"verification refused its plans by {plans[0]}" if plans else _why(cycles[lost])
    if lost == 0:
        return f"a constraint: no plan was safe from the first cycle on ({end}): {why}"
    before, now = cycles[lost - 1]["step"], cycles[lost]["step"]
    return (
        f"the planner: its plan of step {before} was still safe, from step {now} on none was any "
        f"more ({end}): {why}"
    )


def _since(cycles: Sequence[Cycle], failing: Callable[[Cycle], bool]) -> int | None:
    """Since which cycle all to the last one fail; None: the last one does not."""
    since = None
    for index in range(len(cycles) - 1, -1, -1):
        if not failing(cycles[index]):
            break
        since = index
    return since


def _why(cycle: dict[str, Any]) -> str:
    """What stood against the goal in a cycle: constraint, time step, obstacle and margin."""
    plans = refused_plans(cycle)
    reaching = sum(report["reaching_goal"] for report in cycle["seeds"].values())
    if plans and (reaching or not _rejections(cycle)):
        return f"verification refused its plans by {plans[0]}"
    rejections = _rejections(cycle)
    if not rejections:
        return "no candidates were sought" if not cycle["seeds"] else _counts(cycle)
    told = "; ".join([_counts(cycle), *(_rejection(*one) for one in rejections[:TOLD])])
    return told + (f"; verification refused a plan by {plans[0]}" if plans else "")


def _rejections(cycle: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """By constraint, over all sources; the collision first, then those that refused most."""
    found: dict[str, dict[str, Any]] = {}
    for report in cycle["seeds"].values():
        for name, one in report["rejected"].items():
            if name not in found or one["count"] > found[name]["count"]:
                found[name] = one
    return sorted(found.items(), key=lambda item: (item[0] != COLLISION, -item[1]["count"]))


def _counts(cycle: dict[str, Any]) -> str:
    reports = cycle["seeds"].values()
    tried, drivable, reaching = (
        sum(report[key] for report in reports)
        for key in ("candidates", "accepted", "reaching_goal")
    )
    return f"at step {cycle['step']} {drivable} of {tried} candidates were drivable and " + (
        f"{reaching} reached the goal, none of which became a plan"
        if reaching
        else "none reached the goal"
    )


def _rejection(name: str, one: dict[str, Any]) -> str:
    who = f" with obstacle {one['obstacle']}" if one["obstacle"] is not None else ""
    when = f" at step {one['step']}" if one["step"] is not None else ""
    return (
        f"{name}{who}{when} refused {one['count']}, the best of them by "
        f"{one['smallest_violation']:g} {one['unit']}"
    )
