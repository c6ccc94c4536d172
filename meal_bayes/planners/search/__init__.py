"""POMCP: Monte Carlo tree search in sampled MOMDPs, from the exact belief."""
