"""Studies that ship: files for `laisn study`, and packages of those with findings or a design of
their own.

Imports:
"""
