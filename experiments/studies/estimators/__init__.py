"""The study of the estimators: LAISN-2, the tightly coupled navigator and the Cramér–Rao bound, on the same noise.

`cases` has assumptions and errors, `runs` computes one mission, `study` all of them, and `findings` makes the record,
which `figures` and `page.md.j2` show.

Imports: experiments.campaign experiments.findings experiments.flight experiments.intervals experiments.pages laisn sim
"""
