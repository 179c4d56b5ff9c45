"""Level L4 and counterfactuals: a recorded fleet again in simulation, many times, or with other decisions.

docs/closed_loop.md says what is kept of a recording and what is drawn anew.
"""
