"""Factored value iteration: the paper's problem solved on a grid of marginal beliefs."""
