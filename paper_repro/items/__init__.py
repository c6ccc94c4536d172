"""One script for each table, figure or claim of the paper."""
