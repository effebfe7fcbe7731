"""The study of the estimators: LAISN-2, the tightly coupled navigator and the Cramér–Rao bound, on the same noise.

`cases` has assumptions and errors, `runs` computes one mission, `study` all of them, and `findings` makes the record,
which the page, `page.md.j2`, shows.

Imports: experiments.campaign experiments.findings experiments.flight experiments.intervals experiments.pages laisn sim
"""
