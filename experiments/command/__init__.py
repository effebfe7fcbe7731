"""The `laisn` command: arguments in, results and readable messages out.

`cli` is the list of subcommands; heavy imports stay inside them, so that `--help` answers at once. A fault of the
user's is shown on one screen, a bug of the program's goes to a file (`errors`). Nothing imports this room.

Imports: experiments laisn sim
"""
