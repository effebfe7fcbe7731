"""The study of followers that keep formation by what they receive.

Imports: experiments.campaign experiments.findings experiments.flight experiments.intervals experiments.pages
experiments.study laisn sim
"""
