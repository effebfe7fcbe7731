"""The study of the estimators: LAISN-2, the tightly coupled navigator and the Cramér–Rao bound, on
the same noise.

Imports: experiments.study laisn reports sim
"""
