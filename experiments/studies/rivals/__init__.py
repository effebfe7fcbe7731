"""The study of rival methods: all navigators of the registry on the paper's routes, with the same noise.

The study files have its parts, `findings` makes numbers of their rows, and `figures` draws them.

Imports: experiments.campaign experiments.findings experiments.intervals experiments.pages experiments.study
experiments.flight laisn sim
"""
