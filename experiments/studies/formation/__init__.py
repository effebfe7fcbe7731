"""The study of followers that keep formation by what they receive.

Imports: experiments.findings experiments.flight experiments.intervals experiments.pages
experiments.study laisn sim
"""
