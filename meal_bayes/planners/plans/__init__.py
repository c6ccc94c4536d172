"""Open-loop plans by errors that are exact or too high: a planner, and the leaf of a search."""
