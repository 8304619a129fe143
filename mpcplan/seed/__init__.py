"""Seeds: sampled trajectories along a road that decide what to do."""
