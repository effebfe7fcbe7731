"""One flight: the scenario behind a name, its simulation, its summary and tables, and its folder.

Imports: experiments.campaign experiments.result_files laisn models reports sim
"""
