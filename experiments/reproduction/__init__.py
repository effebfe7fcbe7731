"""The paper's evaluation, flown again: five stages, tables beside the published ones, claims judged.

`study` is where it begins; `stages` holds every setting as data.

Imports: experiments.campaign experiments.findings experiments.flight experiments.intervals experiments.pages laisn sim
"""
