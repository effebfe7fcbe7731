"""A user's own study: factors, draws and arms of a file become a design, flights, tables and a
page.

Imports: experiments.campaign experiments.flight laisn reports sim
"""
