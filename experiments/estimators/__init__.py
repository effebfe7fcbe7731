"""The comparison of the tightly coupled navigator with LAISN-2 and with the Cramér–Rao bound, on the same noise.

Takes the paper's point motion and sensors, and what can go wrong beside them (`cases`); prints a table: `python -m
experiments.estimators.table`. Nothing else depends on it.

Imports: experiments.campaign experiments.reproduction laisn sim
"""
