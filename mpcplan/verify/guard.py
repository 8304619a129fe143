"""How far a plan is verified, and what is done when nothing passes.

A plan is safe when it, followed by a fail-safe tail (braking to a standstill along the lane),
passes verification. Where the others' motion is recorded, that is asked of the whole plan. Where
it is a guess, the plan is verified as far as the guess is good, and the tail begins there; such a
tail, made anew in every cycle and hardly ever driven, may cut the road's edge a little. Should no
plan pass, one that can still be broken off safely after the next replanning interval may be driven
that long; else one that trusts those who follow the vehicle at a safe distance when the tail begins
to stay behind it; after that only braking is left.

Who stands now may go on standing, whatever is guessed: who waits for a reason that is not seen is
guessed to drive off in every cycle anew, and plans that count on it creep into him. With
``verify.waiting`` a plan must also be safe from all who stand if it is broken off at the next cycle
and they have not moved.
"""

import numpy as np

from mpcplan.config import Config
from mpcplan.observation import Box, Forecast
from mpcplan.road.road import Road
from mpcplan.trajectory import Array, Trajectory
from mpcplan.verify.behind import follows
from mpcplan.verify.drivability import PASSED, Finding, check_collision, verify
from mpcplan.verify.failsafe import braking_along, braking_tail
from mpcplan.verify.held import held

STANDS = 0.1  # m/s, slower stands
# shares of the fail-safe deceleration that emergency braking tries
SOFT_FIRST = (0.3, 0.6, 1.0, 1.35)  # where motion is a guess, which may well be too gloomy
FIRM_FIRST = (1.0, 1.35, 0.6, 0.3)  # where it is known: to stop soon leaves most ways to go on


class Guard:
    """Verification of plans against one forecast; see the module.

    Attributes:
        certain: time steps for which guessed motion is good enough to verify plans against it.
    """

    def __init__(self, config: Config, dt: float) -> None:
        self._config, self._dt = config.verify, dt
        self._reaction = config.rules.reaction
        self.certain = round(self._config.horizon / dt)
        self._interval = max(round(config.drive.replan / dt), 1)

    def tail(self, road: Road, trajectory: Trajectory) -> Trajectory:
        """Braking to a standstill from the end of a trajectory."""
        state, step = trajectory.states[-1], trajectory.last_step
        return braking_tail(road, state, step, self._config.braking, self._dt)

    def broken_off(self, trajectory: Trajectory, road: Road, step: int) -> Trajectory:
        """A plan up to a time step within it, and braking to a standstill from there."""
        near, braking = trajectory.until(step), self._config.braking
        tail = braking_along(road, trajectory, step, braking, self._dt)
        return near.then(tail if tail is not None else self.tail(road, near))

    def answer(self, forecast: Forecast, plan: Trajectory) -> Forecast:
        """The forecast if a plan is driven."""
        return held(forecast, plan) if self._config.held else forecast

    @property
    def trusts(self) -> bool:
        """Whether those who follow may be trusted where no other plan leads to the goal."""
        return self._config.trusting

    def verify(
        self, trajectory: Trajectory, road: Road, forecast: Forecast, now: int,
        trusting: bool = False,
    ) -> Finding:  # fmt: skip
        """The finding on a plan that is to be driven from time step ``now`` on.

        ``trusting``: who follows when the tail begins is expected to stay behind.
        """
        if forecast.exact:
            return verify(trajectory, forecast, road.area, self._config)
        waiting = self._while_they_stand(trajectory, road, forecast, now)
        if not waiting.ok:
            return waiting
        return self._finding(trajectory, road, forecast, now + self.certain, trusting)

    def until_next(
        self, trajectory: Trajectory, road: Road, forecast: Forecast, now: int
    ) -> Finding:
        """The finding on driving a plan until the next cycle, and braking from there."""
        waiting = self._while_they_stand(trajectory, road, forecast, now)
        if not waiting.ok:
            return waiting
        return self._finding(trajectory, road, forecast, now + self._interval, False)

    def _while_they_stand(
        self, trajectory: Trajectory, road: Road, forecast: Forecast, now: int
    ) -> Finding:
        """The collision of a plan, broken off at the next cycle, with who stands now and stays."""
        if not self._config.waiting:
            return PASSED
        step = now + self._interval
        if step < trajectory.last_step:
            trajectory = self.broken_off(trajectory, road, step)
        return check_collision(trajectory, _standing(forecast, now), self._config.margin)

    def _finding(
        self, trajectory: Trajectory, road: Road, forecast: Forecast, step: int, trusting: bool
    ) -> Finding:
        if step < trajectory.last_step:
            trajectory = self.broken_off(trajectory, road, step)
        forecast = self.answer(forecast, trajectory)
        behind = None
        if trusting and step < trajectory.last_step:
            state = trajectory.states[step - trajectory.first_step]
            behind = follows(state, step, forecast, self._config.braking, self._reaction)
        return verify(trajectory, forecast, road.area, self._config, step, behind)

    def emergency(
        self, road: Road, state: Array, step: int, forecast: Forecast
    ) -> tuple[Trajectory, Finding]:
        """Braking along the lane: the first that is safe (where motion is guessed the softest), or
        what stays safe longest, of those the hardest."""
        soon = None if forecast.exact else step + self._interval
        checked = []
        for share in FIRM_FIRST if forecast.exact else SOFT_FIRST:
            tail = braking_tail(road, state, step, share * self._config.braking, self._dt)
            finding = verify(tail, forecast, road.area, self._config, soon)
            if finding.ok:
                return tail, finding
            checked.append((finding.step or 0, share, tail, finding))
        _, _, tail, finding = max(checked, key=lambda found: found[:2])
        return tail, finding


def _standing(forecast: Forecast, now: int) -> Forecast:
    """Those who stand at a time step, for ever."""
    boxes = forecast.at(np.array([now]))
    with np.errstate(invalid="ignore"):
        rows = np.flatnonzero(np.abs(boxes[:, 0, Box.V]) < STANDS)  # NaN, not there, is none
    ids = tuple(forecast.ids[row] for row in rows.tolist())
    return Forecast(now, ids, boxes[rows], np.ones(len(rows), bool))
