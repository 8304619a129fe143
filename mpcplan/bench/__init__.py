"""Many scenarios in separate processes: results, tables and comparisons."""

from mpcplan.bench.comparison import compare
from mpcplan.bench.run import bench
from mpcplan.bench.table import summary

__all__ = ["bench", "compare", "summary"]
