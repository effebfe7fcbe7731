"""The paper's evaluation, run again: five stages, tables beside the published ones, claims judged.

Imports: experiments.campaign experiments.flight experiments.study laisn reports sim
"""
