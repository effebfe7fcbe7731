"""The study of a leader that is not level: what pitch does to ranges and fixes, and what helps.

Imports: experiments.campaign experiments.flight experiments.study laisn reports sim
"""
