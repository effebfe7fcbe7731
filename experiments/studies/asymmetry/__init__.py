"""The study of a leader that is not level: what pitch does to ranges and fixes, and what helps.

`study` is where it begins: conditions that make the leader pitch, a map of noiseless fixes, missions with and without
each remedy, and a page of the results.

Imports: experiments.campaign experiments.findings experiments.flight experiments.intervals experiments.pages laisn sim
"""
