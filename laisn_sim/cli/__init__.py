"""The `laisn` command: arguments in, results and readable messages out (`main`, `errors`). Nothing
imports this package.

Imports: experiments laisn laisn_sim reports sim
"""
