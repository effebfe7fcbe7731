"""What studies fly: cells of thousands of runs and the kernels that fly them, tasks, processes, and
the store.

Takes a design of scenarios with numbers of runs, and of tasks; gives rows, each computed once and
kept under a key of everything that made it, with the version of the code. Results depend neither on
workers nor on interruptions. It must not depend on the purpose of a study: no page, no figure, no
claim.

Imports: experiments.result_files laisn reports sim
"""
