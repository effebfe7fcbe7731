"""What is done with the simulator: single flights, campaigns of thousands, studies, pages, and the
`laisn` command.

Imports: laisn reports sim
"""
