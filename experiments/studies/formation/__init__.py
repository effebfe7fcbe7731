"""The study of followers that keep formation by what they receive.

`study.toml` has the conditions of sea, sound and sensors as its arms; `study` flies ten followers through each and
writes record and page; `limits` are those of the acoustic channel and of the bound.

Imports: experiments.campaign experiments.findings experiments.flight experiments.intervals experiments.pages
experiments.study laisn sim
"""
