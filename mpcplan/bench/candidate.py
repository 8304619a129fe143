"""A driven solution before the official verdict: our own verification of the whole drive."""

import shapely

from mpcplan.config import VerifyConfig
from mpcplan.road.limits import drivable_area
from mpcplan.simulate.run import Drive, Run
from mpcplan.verify.drivability import PASSED, Finding, check_kinematics, check_road, separation


def verify_run(run: Run) -> Finding:
    """The first of our own checks that a run fails, or ``PASSED``.

    Kinematics, no overlap with anybody at any time step (on the traffic as it was when the run was
    driven), and the road; the same checks as for every plan, without its margins.
    """
    if not run.solved:
        return Finding(False, "goal", detail=run.cause)
    area = drivable_area(run.loaded.scenario)
    findings = (_verify(drive, area, run.config.verify) for drive in run.drives)
    return next((finding for finding in findings if not finding.ok), PASSED)


def _verify(drive: Drive, area: shapely.Geometry, config: VerifyConfig) -> Finding:
    for finding in (
        check_kinematics(drive.trajectory, config.position_tolerance),
        _check_overlap(drive),
        check_road(drive.trajectory, area),
    ):
        if not finding.ok:
            return finding
    return PASSED


def _check_overlap(drive: Drive) -> Finding:
    for others in drive.others:
        if not others.ids:
            continue
        state = drive.trajectory.state_at(others.step)
        gap = separation(state[None], others.boxes[:, None])[:, 0]
        nearest = int(gap.argmin())
        if gap[nearest] < 0:
            return Finding(
                False, "collision", others.step, others.ids[nearest], float(gap[nearest]), "m",
                "gap",
            )  # fmt: skip
    return PASSED
