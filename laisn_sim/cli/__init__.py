"""The `laisn` command: arguments in, results and readable messages out (`main`, `errors`). Nothing
imports this package.

Imports: experiments laisn reports sim
"""
