"""Numbers, tables and pictures of README and docs: `make figures`, `make studies`, `make check`.

Reads the records of the studies, runs what it needs, and writes into `docs`.
"""
