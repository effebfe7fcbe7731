"""Reports: self-contained HTML pages of text, tables, figures and films.

Takes flights and numbers; gives one file that needs no network. `page` and `figures` are the vocabulary of all
reports, `flight_report` describes one flight, and `results` has flights as Python's users get them.

Imports: experiments.campaign experiments.findings experiments.flight laisn sim
"""
