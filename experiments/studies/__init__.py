"""Studies that ship: files for `laisn study`, and modules and packages of those whose design no file can hold.

Imports: experiments.beacon_replay experiments.campaign experiments.findings experiments.flight experiments.intervals
experiments.study laisn sim
"""
