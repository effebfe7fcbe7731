"""Speed and memory beside peers and floors, measured in one run: `make bench`.

Takes nothing and prints ratios; no result of the project depends on it.

Imports: experiments.campaign experiments.flight laisn sim
"""
