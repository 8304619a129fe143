"""Interactive scenarios: folders whose traffic SUMO moves."""
