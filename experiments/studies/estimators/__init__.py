"""The study of the estimators: LAISN-2, the tightly coupled navigator and the Cramér–Rao bound, on the same noise.

Its parts are study files with an arm for each navigator; `errors` are those that cases add to the paper's noise,
`findings` makes the record, which the page shows.

Imports: experiments.campaign experiments.findings experiments.intervals experiments.pages experiments.study laisn sim
"""
