"""Safe-RRT and its strategies."""
