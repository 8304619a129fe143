"""The choice among options: whom a plan to the goal trusts where no other leads there."""

from types import SimpleNamespace

import pytest

from mpcplan.choice import choose
from mpcplan.plan import Option
from mpcplan.verify.drivability import Finding

PASSED, REFUSED = Finding(True), Finding(False, "collision", 12)


class TrustingGuard:
    """Finds those plans safe that are trusted to be; a plan is known by its name."""

    def __init__(self, trusted: set[str], trusts: bool = True) -> None:
        self._trusted, self.trusts = trusted, trusts

    def verify(self, plan, road, forecast, now, trusting=False) -> Finding:
        """The finding on a plan that trusts who follows."""
        assert trusting
        return PASSED if plan in self._trusted else REFUSED


def option(name: str, cost: float, reaches: bool, finding: Finding) -> Option:
    """An option whose trajectory is its name."""
    seed = SimpleNamespace(road=None)
    return Option(name, seed, cost, reaches, finding, name)


def chosen(
    best: Option, refused: list[Option], trusted: set[str], exact: bool = False, trusts: bool = True
):
    """What is chosen, and why."""
    cycle = SimpleNamespace(
        observation=SimpleNamespace(step=3), forecast=SimpleNamespace(exact=exact), notes=[]
    )
    return choose(cycle, TrustingGuard(trusted, trusts), None, [best], refused)


STOP = option("stop", 700.0, False, PASSED)
MERGE = option("merge", 250.0, False, REFUSED)
ARRIVE = option("arrive", 900.0, True, REFUSED)
DEAR = option("dear", 800.0, False, REFUSED)


@pytest.mark.parametrize(
    ("trusted", "name"),
    [
        (set(), "stop"),
        ({"merge"}, "merge"),
        ({"merge", "arrive"}, "arrive"),
        ({"dear"}, "stop"),
    ],
)
def test_who_cannot_reach_the_goal_otherwise_trusts_who_follows(trusted, name):
    best, why = chosen(STOP, [DEAR, MERGE, ARRIVE], trusted)
    assert best.source == name
    assert (why is None) is (name == "stop")
    if why is not None:
        assert why.startswith("a plan that trusts who follows is driven to the goal: ")


def test_a_plan_that_reaches_the_goal_needs_no_trust():
    best, why = chosen(option("go", 950.0, True, PASSED), [MERGE, ARRIVE], {"merge", "arrive"})
    assert best.source == "go" and why is None


def test_where_the_others_motion_is_known_nobody_is_trusted():
    assert chosen(STOP, [MERGE], {"merge"}, exact=True)[0] is STOP


def test_nobody_is_trusted_who_is_not_to_be():
    assert chosen(STOP, [MERGE], {"merge"}, trusts=False)[0] is STOP
