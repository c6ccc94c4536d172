"""The paper's tables and figures, run again and judged; `meal-bayes reproduce` runs them.

An item is a script in `items/`, with one function `run(setting) -> Result`, and a section of
`paper_values.toml`: what the paper prints of it and the margins of its statements, written down
before the run. The order of the sections is the order of the items.
"""
