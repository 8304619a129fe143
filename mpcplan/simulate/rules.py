"""How a run kept the traffic rules, by what the vehicle saw."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mpcplan.observation import as_forecast
from mpcplan.predict.recorded import static_ids
from mpcplan.rules.judge import RulesDriven, judge_rules
from mpcplan.rules.keeping import KEEPING, NOT_REGAINED, REGAINED

if TYPE_CHECKING:
    from mpcplan.simulate.run import Run


def rules_of(run: "Run") -> tuple[RulesDriven, ...]:
    """How each drive of a run kept the rules; the others are those that were there, recorded or
    simulated with it.

    Raises:
        RoadError: no route leads from a start.
    """
    standing = static_ids(run.loaded.scenario)
    road_map, config, found = run.loaded.scenario, run.config, []
    for problem, drive in zip(run.loaded.problems, run.drives, strict=True):
        task, driven, others = problem.planning_problem, drive.trajectory, as_forecast(drive.others)
        parked = np.array([number in standing for number in others.ids], bool)
        rules = judge_rules(road_map, task, driven, others, parked, config)
        if drive.collided and rules.kept == REGAINED:  # who is touched is in front no more
            rules = replace(rules, kept=NOT_REGAINED)
        found.append(rules)
    return tuple(found)


def together(rules: Sequence[RulesDriven]) -> RulesDriven:
    """The worst of several drives, rule by rule; there is one at least."""
    return RulesDriven(
        min((drive.safe_distance for drive in rules), key=lambda rule: rule.lowest),
        min((drive.traffic_flow for drive in rules), key=lambda rule: rule.lowest),
        max((drive.kept for drive in rules), key=KEEPING.index),
    )
