"""Figures of single planning cycles: candidates, forecast, sparsity, tail, and the game."""

import re
from pathlib import Path

import made
import numpy as np
import pytest
from matplotlib.colors import to_hex

from mpcplan.config import Config
from mpcplan.errors import InputError
from mpcplan.game.actions import Command
from mpcplan.game.decide import Order
from mpcplan.game.levels import LEVELS
from mpcplan.observation import Box
from mpcplan.rules.judge import Robustness, RulesDriven
from mpcplan.seed.judge import TOLERANCE
from mpcplan.seed.seed import COLLISION
from mpcplan.show.agents import agents_over_time, plot_beliefs, plot_others
from mpcplan.show.candidates import ACCEPTED, COLLIDES, candidates_of, plot_candidates
from mpcplan.show.cycles import LookedInto, look_into
from mpcplan.show.forecast import foreseen, plot_forecast
from mpcplan.show.game import chosen_path, games, plot_decision
from mpcplan.show.refined import refined_plan_at
from mpcplan.show.rules import plot_rules
from mpcplan.show.sparsity import plot_sparsity, sparsity_of
from mpcplan.show.tail import CHECKED, DRIVEN, TAIL, plot_tail, verified
from mpcplan.show.traffic import traffic_of
from mpcplan.simulate.loop import drive
from mpcplan.simulate.rules import rules_of
from mpcplan.trajectory import Trajectory
from mpcplan.vehicle import centres
from mpcplan.verify.drivability import check_kinematics

ROOT = Path(__file__).resolve().parents[1]
JUNCTION = ROOT / "scenarios" / "ZAM_TJunction-1_1_T-1.xml"
GUESSED = {"kind": "lane_follow", "alternative": 0.05}
DT = 0.1


@pytest.fixture(scope="module")
def junction() -> LookedInto:
    """The first 1.2 s at a T-junction, with the game, the others' motion guessed."""
    config = {"predict": GUESSED, "game": {"enabled": True}, "drive": {"steps_max": 12}}
    return look_into(JUNCTION, Config.model_validate(config))


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """4 s along a straight road behind a car that is slower."""
    problem = made.problem(100, made.state(10, made.LANE / 2, 10), made.rectangle_goal(45))
    car = made.car(30, 35, made.LANE / 2, 7)
    return made.write(tmp_path_factory.mktemp("scenario"), problem, obstacles=[car])


@pytest.fixture(scope="module")
def known(path) -> LookedInto:
    """Driven with the recording as prediction: all is known."""
    return look_into(path, Config())


# ---------------------------------------------------------------- cycles


def test_looking_changes_nothing(path, known):
    """The planner that notes drives as the usual one does."""
    usual = drive(known.run.loaded, Config())
    for driven, noted in zip(usual.drives, known.run.drives, strict=True):
        np.testing.assert_array_equal(driven.trajectory.states, noted.trajectory.states)


def test_every_cycle_is_noted_as_it_was(junction):
    cycles = junction.run.drives[0].cycles
    assert [moment.step for moment in junction.moments] == [cycle.step for cycle in cycles]
    for moment, cycle in zip(junction.moments, cycles, strict=True):
        assert moment.plan is cycle.plan and moment.forecast.first_step == cycle.step
        assert moment.played is not None and moment.played.as_dict() == cycle.plan.trace["game"]
        assert all(p.problem.seed.first_step == cycle.step for p in moment.problems)
    assert len(junction.problems) == sum(len(moment.problems) for moment in junction.moments) > 0


def test_a_cycle_is_found_by_the_step_that_it_drove(junction):
    assert junction.at(0).step == 0
    assert junction.at(4).step == 3
    with pytest.raises(InputError, match="no planning cycle at step 13; it was driven from step 0"):
        junction.at(13)


def test_several_problems_are_refused():
    with pytest.raises(InputError, match="several planning problems"):
        look_into(ROOT / "scenarios" / "C-ZAM_ParallelEgos-1_1_T-1.xml", Config())


# ---------------------------------------------------------------- candidates


def test_candidates_are_those_of_the_cycle(junction):
    """Judged again they give the report that is in the trace."""
    moment = junction.at(3)
    found = candidates_of(moment, DT)
    assert found.judged.report.as_dict() == moment.plan.trace["seeds"]["lattice"]
    assert (found.verdict == ACCEPTED).sum() == found.judged.report.accepted > 0
    hit = found.judged.violations[COLLISION][0] > TOLERANCE
    assert (hit[found.verdict == COLLIDES]).all() and not hit[found.verdict == ACCEPTED].any()


def test_the_cheapest_is_accepted_and_starts_at_the_vehicle(junction):
    found = candidates_of(junction.at(3), DT)
    assert found.best is not None and found.judged.accepted[found.best]
    cost = found.judged.cost[found.judged.accepted]
    assert found.judged.cost[found.best] == cost.min()
    np.testing.assert_allclose(found.s[..., 0], found.judged.pose.s)
    along = found.s[found.best]
    assert (np.diff(along[np.isfinite(along)]) >= -1e-9).all()


def test_candidates_figure_tells_counts_and_constraints(junction):
    moment = junction.at(3)
    figure = plot_candidates(junction, moment)
    report = candidates_of(moment, DT).judged.report
    title = figure.get_suptitle()
    assert f"{report.candidates} candidates" in title and f"{report.accepted} accepted" in title
    bars = next(axes for axes in figure.axes if axes.get_title(loc="left").startswith("why"))
    names = [text.get_text() for text in bars.get_yticklabels()]
    widths = [bar.get_width() for bar in bars.patches]
    assert dict(zip(names, widths, strict=True)) == {
        name: rejection.count for name, rejection in report.rejected.items()
    }


def test_no_candidate_at_all_is_no_error(junction):
    """Where everything is refused there is no cheapest, and the figure is drawn all the same."""
    moment = junction.at(3)
    walls = moment.config.model_copy(
        update={"road": moment.config.road.model_copy(update={"lateral_acceleration": 0.51})}
    )
    strict = type(moment)(**{**vars(moment), "config": walls})
    found = candidates_of(strict, DT)
    assert found.judged.report.accepted < candidates_of(moment, DT).judged.report.accepted
    plot_candidates(junction, strict)


# ---------------------------------------------------------------- forecast


def test_known_motion_has_no_error_and_no_spread(known):
    (row,) = foreseen(known, known.at(0))
    assert row.main and np.nanmax(row.off) < 1e-9 and not row.spread.any()


def test_guessed_motion_spreads_with_the_way_driven(junction):
    moment = junction.at(6)
    rows = foreseen(junction, moment, seconds=0.6)
    assert [row.main for row in rows] == sorted((row.main for row in rows), reverse=True)
    assert {row.obstacle for row in rows if not row.main}  # a turn that is less likely
    share = moment.config.predict.spread_along
    for row in rows:
        boxes = moment.forecast.boxes[moment.forecast.ids.index(row.obstacle)]
        way = np.hypot(*(boxes[len(row.time) - 1] - boxes[0])[: Box.PSI])
        if row.main:
            assert row.spread[-1] == pytest.approx(share * way, rel=0.02)
            assert row.off[0] < 1e-9 and len(row.off) == len(row.time) == 7


def test_forecast_figure_shows_obstacles_and_plan(junction):
    moment = junction.at(6)
    on_map, errors = plot_forecast(junction, moment).axes
    named = {text.get_text() for text in on_map.texts}
    assert named == {str(number) for number in moment.observation.now.ids}
    assert errors.get_xlabel() == "time since the cycle [s]" and "[m]" in errors.get_ylabel()
    drawn = [line for line in on_map.lines if line.get_label() == "the ego vehicle's plan"]
    planned = centres(moment.plan.trajectory.states)
    points = np.column_stack(drawn[0].get_data())
    np.testing.assert_array_equal(points, planned[: len(points)])


# ---------------------------------------------------------------- sparsity


def test_sparsity_is_that_of_the_subproblem(known):
    problem = known.problems[0].problem
    found, lay = sparsity_of(problem), problem.layout
    assert found.matrix.shape == (lay.n_rows, lay.n_vars)
    assert found.hessian.shape == (lay.n_vars, lay.n_vars)
    assert abs(found.hessian - found.hessian.T).max() == 0
    assert sum(found.matrix[rows].nnz for rows in found.blocks.values()) == found.matrix.nnz
    assert found.blocks["dynamics"].stop == 6 * problem.n
    assert (found.matrix[found.blocks["bounds"]].getnnz(axis=1) == 1).all()
    lines = found.told().splitlines()
    assert lines[2].split()[:4] == ["A", str(lay.n_rows), str(lay.n_vars), str(found.matrix.nnz)]


def test_sparsity_leaves_the_layout_as_it_was(known):
    """Zeros are left out of a copy: the pattern is shared with the solvers."""
    problem = known.problems[0].problem
    before = problem.layout.a.indices.copy(), problem.layout.a.indptr.copy()
    first = sparsity_of(problem).told()
    np.testing.assert_array_equal(problem.layout.a.indices, before[0])
    np.testing.assert_array_equal(problem.layout.a.indptr, before[1])
    assert sparsity_of(problem).told() == first


def test_sparsity_figure_dots_are_the_nonzeros(known):
    problem = known.problems[0].problem
    h, a, _ = plot_sparsity(problem).axes
    found = sparsity_of(problem)
    assert sum(len(line.get_xdata()) for line in h.lines) == found.hessian.nnz
    assert {line.get_label(): len(line.get_xdata()) for line in a.lines} == {
        name: found.matrix[rows].nnz for name, rows in found.blocks.items()
    }


# ---------------------------------------------------------------- the tail


def test_tail_comes_to_rest_where_the_guess_ends(junction):
    moment = junction.at(3)
    found = verified(moment, DT)
    horizon, replan = moment.config.verify.horizon, moment.config.drive.replan
    assert list(found.parts) == [DRIVEN, CHECKED, TAIL] and found.finding.ok
    assert found.parts[DRIVEN].last_step == moment.step + round(replan / DT)
    assert found.parts[TAIL].first_step == moment.step + round(horizon / DT)
    whole: Trajectory = found.trajectory
    assert whole.states[-1, 3] == pytest.approx(0.0, abs=1e-9)
    assert check_kinematics(whole, 1e-6).ok
    near = moment.plan.trajectory.until(found.parts[TAIL].first_step)
    np.testing.assert_array_equal(whole.until(near.last_step).states, near.states)
    assert (found.gap[1:] >= found.margin - 1e-9).all()


def test_known_motion_is_verified_to_the_end(known):
    found = verified(known.at(0), DT)
    assert list(found.parts) == [DRIVEN, CHECKED]
    assert found.trajectory.last_step == known.at(0).plan.trajectory.last_step


def test_tail_figure_shows_the_parts(junction):
    moment = junction.at(3)
    scene, speed, gap = plot_tail(junction, moment).axes
    labels = [line.get_label() for line in scene.lines]
    assert labels == [DRIVEN, CHECKED, TAIL]
    found = verified(moment, DT)
    ends = np.concatenate([line.get_ydata() for line in speed.lines])
    assert ends.min() == pytest.approx(0.0, abs=1e-9)
    assert len(gap.lines) == len(found.parts) + 1  # and the margin


def test_refined_plan_of_a_step(known):
    plan = refined_plan_at(known.run, known.problems, 0)
    assert plan.step == 0
    assert plan.result.as_dict().items() <= known.at(0).plan.trace["refine"].items()
    with pytest.raises(InputError, match=r"no refined plan of step 1; those of these steps are: 0"):
        refined_plan_at(known.run, known.problems, 1)


# ---------------------------------------------------------------- the game


def test_agents_over_time_are_those_of_the_trace(junction):
    agents = agents_over_time(junction)
    traced = [(c.step, c.plan.trace["game"]) for c in junction.run.drives[0].cycles]
    for agent in agents:
        there = [(step, game) for step, game in traced if agent.id in game.get("beliefs", {})]
        np.testing.assert_allclose(agent.time, [DT * step for step, _ in there])
        np.testing.assert_array_equal(agent.beliefs, [g["beliefs"][agent.id] for _, g in there])
        assert [o.value for o in agent.orders] == [g["orders"][agent.id] for _, g in there]
        np.testing.assert_allclose(agent.beliefs.sum(axis=1), 1.0)
    lengths = [len(agent.time) for agent in agents]
    assert lengths == sorted(lengths, reverse=True)


def test_the_chosen_path_starts_at_the_vehicle(junction):
    moment, decision = games(junction)[0]
    path = chosen_path(moment, decision)
    assert len(path) == len(decision.path)
    np.testing.assert_allclose(path[0], centres(moment.observation.state[None])[0], atol=0.02)
    way = np.hypot(*np.diff(path, axis=0).T).sum()
    assert way == pytest.approx(decision.path[-1, 0] - decision.path[0, 0], rel=0.1)


def test_decision_figure(junction):
    moment, decision = games(junction)[0]
    players, beliefs, rewards = plot_decision(junction, moment).axes
    told = [text.get_text() for text in players.texts]
    assert told == [f"{n}: {decision.orders[n].value}" for n in decision.beliefs]
    chosen = [line for line in players.lines if line.get_label() == "ego: chosen"]
    np.testing.assert_array_equal(
        np.column_stack(chosen[0].get_data()), chosen_path(moment, decision)
    )
    heights = np.array([[bar.get_width() for bar in level] for level in beliefs.containers])
    np.testing.assert_allclose(heights.T, np.stack(list(decision.beliefs.values())))
    widths = [bar.get_width() for bar in rewards.patches]
    assert widths == pytest.approx([reward for _, reward in decision.best])
    greens = [to_hex(bar.get_facecolor()) for bar in rewards.patches]
    assert greens[0] != greens[1]  # the best one is the chosen one


def test_beliefs_figure_has_a_strip_per_agent(junction):
    agents = agents_over_time(junction)
    strips = plot_beliefs(junction).axes
    assert [axes.get_ylabel() for axes in strips] == [f"P(k), {agent.id}" for agent in agents]
    for axes, agent in zip(strips, agents, strict=True):
        marks = {line.get_label(): len(line.get_xdata()) for line in axes.lines}
        assert marks == {f"ego: {o.value}": agent.orders.count(o) for o in Order}


def test_others_figure_shows_what_they_did(junction):
    traffic, steps = traffic_of(junction.run), junction.run.drives[0].trajectory.steps
    for axes, agent in zip(plot_others(junction).axes, agents_over_time(junction), strict=True):
        v = traffic.during(steps)[traffic.ids.index(agent.id), :, Box.V]
        drawn = axes.patches[0].get_data()
        np.testing.assert_allclose(drawn.values, np.diff(v) / DT)
        levels = np.stack([line.get_ydata() for line in axes.lines], axis=1)
        np.testing.assert_array_equal(levels, agent.predicted)
        assert levels.shape[1] == LEVELS
    first = games(junction)[0][1]
    agent = next(a for a in agents_over_time(junction) if a.id in first.beliefs)
    assert agent.predicted[0, 0] == first.predicted[agent.id][0, Command.A]


def test_without_a_game_that_is_said(known):
    with pytest.raises(InputError, match=r"no game was played; set game\.enabled"):
        plot_beliefs(known)
    with pytest.raises(InputError, match=r"no game at step 0: game\.enabled is off"):
        plot_decision(known, known.at(0))


# ---------------------------------------------------------------- rules


def test_rules_figure_shows_the_robustness(known):
    rules = rules_of(known.run)
    distance, flow = plot_rules(rules, known.run).axes
    values = rules[0].safe_distance.values
    shown = np.asarray(distance.lines[0].get_ydata())
    np.testing.assert_array_equal(shown[np.isfinite(values)], values[np.isfinite(values)])
    assert np.isfinite(values).any()
    assert re.search(r"\[m\]$", distance.get_ylabel()) and re.search(r"m/s\]$", flow.get_ylabel())


def test_a_rule_that_demands_nothing_says_so(known):
    nothing = Robustness(0, np.full(4, np.inf))
    figure = plot_rules([RulesDriven(nothing, nothing, "kept")], known.run)
    for axes in figure.axes:
        assert [text.get_text() for text in axes.texts] == ["the rule demands nothing"]
