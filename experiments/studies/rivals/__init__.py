"""The study of rival methods: all navigators of the registry on the paper's routes, with the same
noise.

Imports: experiments.findings experiments.flight experiments.intervals experiments.pages
experiments.study laisn sim
"""
