"""One flight: the scenario behind a name, its simulation, its summary and tables, and its folder.

Imports: experiments.campaign laisn models reports sim
"""
