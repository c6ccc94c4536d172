"""Open-loop plans with exact error rates: a planner of its own, and the leaf of the tree search."""
