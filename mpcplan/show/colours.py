"""Colours that stay apart under colour blindness (Okabe and Ito; viridis without its yellow)."""

import matplotlib
import numpy as np
from matplotlib.colors import ListedColormap

PROBLEMS = ("#0072B2", "#CC79A7", "#56B4E9", "#000000")  # one colour per planning problem
VARIANTS = (PROBLEMS[0], PROBLEMS[1], PROBLEMS[3], PROBLEMS[2])  # one per drive compared
COSTS = ("#0072B2", "#E69F00", "#CC79A7", "#999999")  # one per part of TR1
TRAFFIC = "#E69F00"
GOAL = "#009E73"
ALARM = "#D55E00"
ROAD = "#efefef"
EDGE = "#bdbdbd"
PLAN = "#555555"
LIMIT = "#888888"
ACCEPTED = "#56B4E9"  # candidates that keep all constraints
REFUSED = "#7f7f7f"
CORRIDOR = "#CC79A7"
CHOSEN = "#000000"  # the plan of a cycle
GRID = "#e4e4e4"
TIME = ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0, 0.82, 210)))


def of_problem(index: int) -> str:
    """The colour of the index-th planning problem."""
    return PROBLEMS[index % len(PROBLEMS)]


def of_variant(index: int) -> str:
    """The colour of the index-th of several drives compared."""
    return VARIANTS[index % len(VARIANTS)]
