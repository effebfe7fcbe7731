"""A user's own study: factors, draws and arms of a file become a design, flights, tables and a
page.

Imports: experiments.campaign experiments.findings experiments.flight experiments.intervals
experiments.pages laisn sim
"""
