"""The road ahead: route, reference path, Frenet frame, goal windows and limits."""
