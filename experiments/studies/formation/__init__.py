"""The study of followers that keep formation by what they receive.

`conditions` of sea, sound and sensors; `study` flies ten followers through each, run by run, and writes record and
page; `limits` are those of the acoustic channel and of the bound.

Imports: experiments.campaign experiments.findings experiments.flight experiments.intervals experiments.pages
experiments.study laisn sim
"""
