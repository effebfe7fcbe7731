"""One flight: the scenario behind a name, its simulation, its summary and reports, and its folder.

Takes the name of a scenario or of a log; gives a `Flight`, its errors, events and figures (`summary`), the error budget
of its ranges (`range_budget`) and a folder that never holds files of two flights (`folder`). It prints nothing.

Imports: experiments.campaign laisn models sim
"""
