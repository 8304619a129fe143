"""The choice among options, and what is driven where none passes verification."""

from functools import partial

from mpcplan.cycle import Cycle
from mpcplan.develop import KEPT
from mpcplan.plan import Option
from mpcplan.road.road import Road
from mpcplan.verify.guard import Guard

CLEARLY_LONGER = 5  # time steps
REASONS = 3  # told in a fallback


def choose(
    cycle: Cycle, guard: Guard, road: Road, options: list[Option], refused: list[Option]
) -> tuple[Option, str | None]:
    """The best option, or the next fallback with what led to it.

    Args:
        cycle: the present one.
        guard: verifies.
        road: that is driven on.
        options: that passed verification, the best first.
        refused: those that did not.
    """
    reasons = [f"{option.source}: {option.finding}" for option in refused] + cycle.notes
    if options:
        best = options[0]
        trusting = _trusting(cycle, guard, best, refused)
        if trusting is not None:
            return trusting, _why("a plan that trusts who follows is driven to the goal", reasons)
        if best.source == KEPT and reasons:
            return best, _why("the last plan goes on", reasons)
        if best.source.endswith("unrefined"):
            return best, _why("the seed is driven", reasons or ["it could not be improved"])
        return best, None
    return _fall_back(cycle, guard, road, refused, reasons)


def _trusting(cycle: Cycle, guard: Guard, best: Option, refused: list[Option]) -> Option | None:
    """Where no plan that passes leads to the goal: the best refused one that is better and safe if
    those who follow at the safe distance stay behind, as they have to."""
    seen, forecast = cycle.observation, cycle.forecast
    if forecast.exact or best.reaches_goal or not guard.trusts:
        return None
    for option in sorted(refused, key=lambda o: (not o.reaches_goal, o.cost)):
        if option.cost >= best.cost and not option.reaches_goal:
            break
        assert option.seed is not None  # only emergency braking has none
        plan, road = option.trajectory, option.seed.road
        if guard.verify(plan, road, forecast, seen.step, trusting=True).ok:
            return option
    return None


def _fall_back(
    cycle: Cycle, guard: Guard, road: Road, refused: list[Option], reasons: list[str]
) -> tuple[Option, str]:
    """What is driven where no plan passes: one that may be broken off later, one that trusts
    who follows, or braking."""
    seen, forecast = cycle.observation, cycle.forecast
    if not forecast.exact:
        best = sorted(refused, key=lambda o: (not o.reaches_goal, o.cost))
        for what, passes in (
            ("a plan that can still be broken off is driven", guard.until_next),
            ("a plan that trusts who follows is driven", partial(guard.verify, trusting=True)),
        ):
            for option in best:
                assert option.seed is not None  # only emergency braking has none
                if passes(option.trajectory, option.seed.road, forecast, seen.step).ok:
                    return option, _why(what, reasons)
    trajectory, finding = guard.emergency(road, seen.state, seen.step, forecast)
    stop = Option(trajectory, None, float("inf"), False, finding, "emergency braking")
    if not finding.ok and refused:
        # nothing is safe to the end: braking, unless another plan stays safe clearly longer
        last = max(refused, key=lambda o: (o.finding.step or 0, o.reaches_goal))
        if (last.finding.step or 0) >= (finding.step or 0) + CLEARLY_LONGER:
            what = "no plan is safe to its end; the one safe longest is driven"
            return last, _why(what, reasons)
    return stop, _why("emergency braking", reasons)


def _why(what: str, reasons: list[str]) -> str:
    """A fallback in words, with what led to it."""
    return f"{what}: " + ("; ".join(reasons[:REASONS]) or "no seed was found")
