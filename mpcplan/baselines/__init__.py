"""Naive planners that every table of results can be compared with."""
