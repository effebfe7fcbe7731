"""A user's own study: factors, draws and arms of a file become a design, flights, tables and a page.

Takes a TOML file or options of the command; gives results.parquet, runs.parquet, results.json and report.html. What
is flown is planned and validated as a whole first, then flown and stored as a campaign, which owns workers and
resuming. It does not depend on the paper's or the project's studies.

Imports: experiments.campaign experiments.findings experiments.flight experiments.intervals experiments.pages laisn sim
"""
