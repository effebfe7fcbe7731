"""Reports: self-contained HTML pages of text, tables, figures and films.

Takes flights and numbers; gives one file that needs no network. `page` and `figures` are the vocabulary of all
reports, `flight_report` and `range_budget_page` describe one flight. Nothing is flown here.

Imports: experiments.campaign experiments.findings experiments.flight laisn sim
"""
