"""The paper's evaluation, run again: five stages, tables beside the published ones, claims judged.

Imports: experiments.campaign experiments.findings experiments.flight experiments.intervals
experiments.pages experiments.study laisn sim
"""
