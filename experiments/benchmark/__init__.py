"""LAISN-Bench: measurements of followers in a fixed set of missions, and scores of estimates made
from them.

Takes names of missions and seeds, or estimates; gives files and their manifest, or errors. It must
not let truth into what navigators are given.

Imports: experiments.campaign experiments.flight laisn reports sim
"""
