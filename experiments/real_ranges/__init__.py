"""Ranges that were really measured: data sets navigated on, scored against the surveyed path, and the study of them.

Takes logs of data sets (`sim.datasets`) or the data sets themselves; gives what each navigator makes of them
(`navigating`), the record of the study and its figure. It prints nothing.

Imports: experiments laisn sim
"""
