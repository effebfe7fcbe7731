"""The study of a leader that is not level: what pitch does to ranges and fixes, and what helps.

Imports: experiments.campaign experiments.findings experiments.flight experiments.intervals
experiments.pages experiments.study laisn sim
"""
