"""MEAL, the Bayesian way."""
