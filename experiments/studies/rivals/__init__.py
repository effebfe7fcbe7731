"""The study of rival methods: all navigators of the registry on the paper's routes, with the same noise.

`design` has the arms, `findings` makes numbers of their rows, and `study` flies them and writes record and page.

Imports: experiments.campaign experiments.findings experiments.intervals experiments.pages experiments.study
experiments.flight laisn sim
"""
