"""Open-loop plans, by error rates that are exact or too high: a planner of its own, and the leaf of the tree search."""
