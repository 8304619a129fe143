"""One HTML page of the results of a benchmark, or of several against each other."""
