"""The study of rival methods: all navigators of the registry on the paper's routes, with the same
noise.

Imports: experiments.flight experiments.study laisn reports sim
"""
