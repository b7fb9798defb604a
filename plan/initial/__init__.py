"""Where the planners start: random starts, detours around obstacles, RRT paths."""
