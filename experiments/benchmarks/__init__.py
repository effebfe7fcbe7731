"""Speed and memory beside peers and floors, measured in one run: `make bench`.

Takes nothing, prints ratios and keeps their record; no result of the project depends on it.

Imports: experiments.campaign experiments.estimators experiments.findings experiments.flight experiments.intervals
laisn sim
"""
