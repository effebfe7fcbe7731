"""The study of followers that keep formation by what they receive.

`study.toml` has the conditions of sea, sound and sensors as its arms, each flown by ten followers; `findings` makes the
record of their rows; `limits` are those of the acoustic channel and of the bound.

Imports: experiments.campaign experiments.findings experiments.flight experiments.intervals experiments.pages
experiments.study laisn sim
"""
