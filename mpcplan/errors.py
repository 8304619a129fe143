"""The package's own exceptions: what is wrong, where, and what to do next."""


class MpcplanError(Exception):
    """Base of all errors that the package raises on purpose."""


class InputError(MpcplanError):
    """The user's input is at fault (file, id, field or time step named); exit code 2."""


class ConfigError(InputError):
    """A configuration key or value is at fault (file, key, value and what is allowed named)."""


class RoadError(MpcplanError):
    """No route, reference path or drivable area could be built for a planning problem."""


class TrafficError(MpcplanError):
    """The simulated traffic cannot go on, or cannot begin (simulator, obstacle and step named)."""


class StartTakenError(TrafficError):
    """Another road user stands where the ego vehicle starts, so that no drive is possible.

    Attributes:
        obstacle: its id.
        overlap: how deep the bodies overlap [m].
        version: of SUMO, '1.28.0'.
    """

    def __init__(self, message: str, obstacle: int, overlap: float, version: str) -> None:
        super().__init__(message)
        self.obstacle, self.overlap, self.version = obstacle, overlap, version


class BoundError(MpcplanError):
    """No clairvoyant way to the goal was found (how many were tried, what refused them)."""


class PlannerError(MpcplanError):
    """A planner that is not ours failed, or returned what no vehicle can drive."""


class RefereeError(MpcplanError):
    """The official checker's process died or answered nothing usable."""
