"""The paper's evaluation, run again: five stages, tables beside the published ones, claims judged.

`study` runs it; `study.toml` and `claims.toml` have every setting and claim as data, `page.md.j2` the page.

Imports: experiments.campaign experiments.findings experiments.flight experiments.intervals experiments.pages
experiments.study laisn sim
"""
