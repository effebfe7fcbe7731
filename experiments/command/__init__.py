"""The `laisn` command: arguments in, results and readable messages out (`cli`, `errors`). Nothing
imports this package.

Imports: experiments laisn sim
"""
