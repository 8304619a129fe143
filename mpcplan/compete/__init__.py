"""The competition's entry point: as many solutions as possible within a budget of time."""

from mpcplan.compete.budget import parse_budget
from mpcplan.compete.run import compete

__all__ = ["compete", "parse_budget"]
