"""The closed loop of planner and traffic, and what a run leaves behind."""
