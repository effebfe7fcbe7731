"""Thousands of runs: cells, the kernels that fly them in lanes, processes that share the work, and the store.

Takes scenarios and numbers of runs; gives rows, each computed once and kept under a key of everything that made it,
with the version of the code. Results depend neither on workers nor on interruptions. It must not know what a study
wants to show: no page, no figure, no claim.

Imports: laisn sim
"""
