"""The `laisn` command: arguments in, results and readable messages out.

`cli` lists the subcommands; heavy imports stay inside them, so that `--help` is quick. Errors of the user's are printed
on one screen, the traceback of a bug goes to a file (`errors`). Nothing imports this package.

Imports: experiments laisn sim
"""
