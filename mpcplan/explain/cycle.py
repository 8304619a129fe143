"""One planning cycle in words: the plan, the options, the game, what refused the candidates."""

from typing import Any

import numpy as np

from mpcplan.errors import InputError
from mpcplan.explain.feared import once, refused_plans
from mpcplan.explain.read import Trace

LONGEST = 50  # time steps between two cycles, where there is only one
EQUAL = 1e-9  # rewards this close are the same


def cycle_lines(trace: Trace, step: int) -> list[str]:
    """The cycle that was driven at a time step, of every planning problem.

    Raises:
        InputError: no cycle planned this step.
    """
    lines: list[str] = []
    for drive in trace["drives"]:
        cycles = [c for c in drive["cycles"] if c["step"] <= step]
        if cycles and step <= _end(drive):
            lines.append(f"problem {drive['problem']}, cycle of step {cycles[-1]['step']}")
            lines += _told(cycles[-1])
    if not lines:
        raise InputError(f"no planning cycle at step {step}; {_which(trace, step)}")
    return lines


def _end(drive: dict[str, Any]) -> int:
    """A time step up to which the last cycle's plan may have been driven."""
    reached, steps = drive.get("reached_step"), [cycle["step"] for cycle in drive["cycles"]]
    if reached is not None:
        return int(reached)
    return int(steps[-1] + max(np.diff(steps), default=LONGEST))


def _which(trace: Trace, step: int) -> str:
    """Which cycles there are, where a step has none."""
    steps = [cycle["step"] for drive in trace["drives"] for cycle in drive["cycles"]]
    if not steps:
        return "there is none at all"
    return (
        f"the first one is of step {min(steps)}"
        if step < min(steps)
        else f"the last one is of step {max(steps)}"
    )


def _told(cycle: dict[str, Any]) -> list[str]:
    lines = [f"driven    {_option(cycle['chosen'])}"]
    if cycle.get("fallback"):
        lines.append(f"fallback  {once(cycle['fallback'])}")
    lines += [
        f"feared    {refused}" for refused in refused_plans(cycle) if refused.obstacle is not None
    ]
    lines += [f"risk      {risk}; the next plan comes sooner" for risk in cycle.get("risks", ())]
    if cycle.get("association"):
        lines.append(f"lane      {_association(cycle['association'])}")
    others = [o for o in cycle["options"] if o != cycle["chosen"]]
    lines += [f"also      {_option(option)}" for option in others]
    if cycle.get("refine"):
        lines.append(f"refined   {_refined(cycle['refine'])}")
    for source, report in cycle["seeds"].items():
        lines += _seeds(source, report)
    if cycle.get("game"):
        lines += _game(cycle["game"])
    times = ", ".join(f"{name} {value:.0f}" for name, value in cycle["times_ms"].items())
    return [*lines, f"times     {times} ms"]


def _association(association: dict[str, Any]) -> str:
    anew = "re-associated" if association["reassociated"] else "not re-associated"
    return f"{anew}: {association['reason']}"


def _option(option: dict[str, Any]) -> str:
    cost = "not judged" if option["cost"] is None else f"cost {option['cost']:.2f}"
    goal = "reaches the goal" if option["reaches_goal"] else "does not reach the goal"
    label = f" ({option['label']})" if option["label"] else ""
    found = option["verify"]
    safe = "" if found["ok"] else f"; refused: {_finding(found)}"
    return f"{option['source']}{label}: {cost}, {goal}{safe}"


def _finding(found: dict[str, Any]) -> str:
    obstacle = f" with obstacle {found['obstacle']}" if "obstacle" in found else ""
    step = f" at step {found['step']}" if "step" in found else ""
    amount = f" ({found.get('detail', '')} {found['amount']:.3g} {found.get('unit', '')}".strip()
    size = amount.replace("( ", "(") + ")" if found.get("unit") else ""
    return f"{found.get('check', 'unknown')}{obstacle}{step}" + (f" {size}" if size else "")


def _refined(refine: dict[str, Any]) -> str:
    return (
        f"TR1 {refine['tr1_before']:.3f} to {refine['tr1_after']:.3f} over {refine['steps']} steps "
        f"in {refine['iterations']} iterations, {refine['status']}"
    )


def _seeds(source: str, report: dict[str, Any]) -> list[str]:
    lines = [
        f"seeds     {source}: {report['accepted']} of {report['candidates']} drivable, "
        f"{report['reaching_goal']} reach the goal"
    ]
    refusals = sorted(report["rejected"].items(), key=lambda item: -item[1]["count"])
    for name, refusal in refusals:
        who = f" with obstacle {refusal['obstacle']}" if refusal["obstacle"] is not None else ""
        when = f" at step {refusal['step']}" if refusal["step"] is not None else ""
        lines.append(
            f"          {name}{who}{when} refused {refusal['count']}, the best of them by "
            f"{refusal['smallest_violation']:g} {refusal['unit']}"
        )
    return lines


def _game(game: dict[str, Any]) -> list[str]:
    """The game: agents, beliefs, best responses, the top sequences and why the chosen one won."""
    lines = [f"game      {reason}" for reason in game["reasons"]]
    if "actions" not in game:
        return lines
    lines.append(f"          the ego vehicle: {_sequence(game['actions'])}")
    for number, belief in game["beliefs"].items():
        shares = ", ".join(f"level {k} {p:.0%}" for k, p in enumerate(belief))
        lines.append(f"          obstacle {number}: {shares}; order: {game['orders'][number]}")
        for k, actions in enumerate(game["responses"][number]):
            lines.append(f"            at level {k} it would: {_sequence(actions)}")
    lines += [
        f"          {one['reward']:12.3f}  {_sequence(one['actions'])}" for one in game["best"]
    ]
    return [*lines, f"          {_why(game['best'])}"]


def _sequence(actions: list[str]) -> str:
    return ", ".join(action.replace("_", " ") for action in actions)


def _why(best: list[dict[str, Any]]) -> str:
    """Why the first of the best sequences was taken."""
    others = [one for one in best[1:] if abs(one["reward"] - best[0]["reward"]) > EQUAL]
    equal = len(best) - 1 - len(others)
    told = f"chosen with the greatest expected reward, {best[0]['reward']:.3f}"
    if equal:
        told += f"; {equal} more of those told are equal, it is the one computed last"
    if others:
        told += f"; the next one has {best[0]['reward'] - others[0]['reward']:.3f} less"
    return told
