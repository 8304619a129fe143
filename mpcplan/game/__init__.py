"""The level-k game with others at intersections without traffic lights."""
