"""Figures of driven scenarios."""

from mpcplan.show.plots import plot_run

__all__ = ["plot_run"]
