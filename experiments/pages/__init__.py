"""Reports: self-contained HTML pages of text, tables and figures; flights as users of Python get
them.

Imports: experiments.campaign experiments.findings experiments.flight laisn sim
"""
